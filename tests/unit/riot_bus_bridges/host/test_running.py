from __future__ import annotations

import signal
import subprocess
import sys
import threading
from contextlib import ExitStack
from typing import Any

import pytest

from riot_bus.control.terminal import Foreground
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus_bridges.bridging import Bridge
from riot_bus_bridges.host.running import Program, run_bridge
from riot_bus_bridges.mavlink.bridge import MavlinkBridge
from riot_bus_bridges.mavlink.options import MavlinkBridgeOptions


class Short(Bridge):
    """A bridge that ends at once, and listens to the network."""

    listens = ("udp/0.0.0.0:14550", "tcp/127.0.0.1:5760")

    def open(self, stack: ExitStack) -> None:
        self.ended.set()

    def status(self) -> dict[str, Any]:
        return {}

    def ready(self) -> str:
        return "ready"

    def summary(self) -> list[str]:
        return ["done"]


def test_links_that_are_open_to_the_network_are_warned_of_before_they_open() -> None:
    said: list[str] = []
    assert run_bridge(Short(), Foreground(said.append, said.append)) == 0
    assert said[0].startswith("warning: a link listens on udp/0.0.0.0:14550: any host that reaches it")
    assert [line for line in said if "listens" in line] == said[:1]


def test_links_of_mavlink_that_listen_are_told() -> None:
    links = ("udpin:0.0.0.0:14550", "tcpin:[::1]:5760", "udpout:127.0.0.1:14551", "tcp:127.0.0.1:5761")
    bridge = MavlinkBridge({}, MavlinkBridgeOptions(links=links))
    assert list(bridge.listens) == ["udp/0.0.0.0:14550", "tcp/[::1]:5760"]
    bridge.loop.close()


DEADLINE = 30.0


class Quiet:
    """A bridge that bridges nothing."""

    failure = None
    listens = ()

    def __init__(self) -> None:
        self._ended = threading.Event()
        self.stop = self._ended.set
        self.wait = self._ended.wait

    def __enter__(self) -> Quiet:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def words(self) -> dict[str, str]:
        return {"port": "5760"}

    def status(self) -> dict[str, object]:
        return {}

    def ready(self) -> str:
        return "ready"

    def summary(self) -> list[str]:
        return ["ended"]


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


@pytest.mark.parametrize(("code", "status"), [("pass", 0), ("raise SystemExit(3)", 3)])
def test_the_bridge_ends_with_its_program(code: str, status: int) -> None:
    bridge, said = Quiet(), []
    done = run_bridge(bridge, Foreground(said.append, said.append), python(code))
    assert (done, said) == (status, ["ready", "ended"])


def test_a_signal_is_told() -> None:
    bridge = Quiet()
    code = "import os; os.kill(os.getpid(), 9)"
    assert run_bridge(bridge, Foreground(str, str), python(code)) == -9


def test_the_program_ends_with_the_bridge() -> None:
    bridge = Quiet()
    assert run_bridge(bridge, Foreground(str, str), python("import time; time.sleep(600)"), look=bridge.stop) == 0
    with Program(python("import time; time.sleep(600)"), bridge) as program:
        pass
    assert program.status == -signal.SIGTERM


def test_words_are_filled_in() -> None:
    bridge = Quiet()
    code = "import sys; sys.exit(sys.argv[1:] != ['5760', 'a{b}5760'])"
    with Program([*python(code), "{port}", "a{b}{port}"], bridge) as program:
        assert bridge.wait(DEADLINE)
        assert program.status == 0


def test_a_program_that_is_not_there() -> None:
    with pytest.raises(EnvironmentFaultError, match="cannot be started"):
        Program(["no-such-program"], Quiet())


def test_this_process_ends_as_the_program_did() -> None:
    code = "from riot_bus_bridges.host.running import end_as; end_as(0); end_as(3); end_as(-15); print('lives')"
    done = subprocess.run(python(code), capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert (done.returncode, done.stdout) == (-signal.SIGTERM, "")
