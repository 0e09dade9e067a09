"""A controller on "another host": in a network namespace of its own, behind a link that is pulled and plugged in."""

from __future__ import annotations

import contextlib
import json
import secrets
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.integration.agent_tools import Process, agent
from tests.integration.play_tools import MS, Listener, numbered, write
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration

COUNT = 100


def ip(*arguments: str) -> None:
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True, timeout=20, check=False)
    if done.returncode:
        raise OSError(done.stderr)


@dataclass
class Elsewhere:
    """A network namespace, and this end of the link to it."""

    name: str
    link: str
    address: str

    def pull(self) -> None:
        ip("link", "set", self.link, "down")

    def plug(self) -> None:
        ip("link", "set", self.link, "up")


@pytest.fixture
def elsewhere() -> Iterator[Elsewhere]:
    tag = secrets.token_hex(3)
    name, here, there = f"riot{tag}", f"ra{tag}", f"rb{tag}"
    network = f"198.{18 + secrets.randbelow(2)}.{secrets.randbelow(256)}"  # for tests between hosts, RFC 2544
    try:
        ip("netns", "add", name)
    except OSError as error:
        pytest.skip(f"no network namespaces here: {error}")
    with contextlib.ExitStack() as stack:
        stack.callback(ip, "netns", "del", name)  # takes the link with it
        try:
            ip("link", "add", here, "type", "veth", "peer", "name", there, "netns", name)
        except OSError as error:
            pytest.skip(f"no virtual links here: {error}")
        ip("address", "add", f"{network}.1/30", "dev", here)
        ip("link", "set", here, "up")
        ip("-n", name, "address", "add", f"{network}.2/30", "dev", there)
        ip("-n", name, "link", "set", there, "up")
        yield Elsewhere(name, here, f"{network}.1")


def test_a_command_from_another_host_outlives_its_link(elsewhere: Elsewhere, tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", numbered(COUNT, "a/x", period=100 * MS))
    with (
        ZenohProcess("router") as bus,
        ZenohProcess("router", listen__endpoints=[f"tcp/{elsewhere.address}:0"]) as hub,
        Listener(bus.locators[0], "a/*") as listener,
        agent(tmp_path, bus.locators[0], hub.locators[0]),
        Process(
            "fleet", "play", "r7", "log.mcap", f"--endpoint={hub.locators[0]}", "--format=json", "--wait=20",
            "--grace=60", inside=["ip", "netns", "exec", elsewhere.name],
        ) as controller,
    ):  # fmt: skip
        listener.wait(10)
        elsewhere.pull()
        before = len(listener.messages)
        assert len(listener.wait(before + 30)) >= before + 30
        elsewhere.plug()
        assert controller.end() == 0, controller.err
        assert listener.payloads(COUNT) == [b'{"v": %d}' % number for number in range(COUNT)]
    assert json.loads(controller.out[0])["state"] == "ended"


def test_a_controller_on_another_host_that_is_cut_off_is_lost_to_the_robot(
    elsewhere: Elsewhere, tmp_path: Path
) -> None:
    write(tmp_path / "log.mcap", numbered(COUNT, "a/x", period=1000 * MS))
    with (
        ZenohProcess("router") as bus,
        ZenohProcess("router", listen__endpoints=[f"tcp/{elsewhere.address}:0"]) as hub,
        Listener(bus.locators[0], "a/*") as listener,
        agent(tmp_path, bus.locators[0], hub.locators[0]) as robot,
        Process(
            "fleet", "play", "r7", "log.mcap", f"--endpoint={hub.locators[0]}", "--wait=20", "--grace=2",
            "--give-up=5", inside=["ip", "netns", "exec", elsewhere.name],
        ) as controller,
    ):  # fmt: skip
        listener.wait(2)
        elsewhere.pull()
        robot.expect("play stopped: the controller was lost for 2 s")
        assert controller.end() == 4, controller.err
        assert "r7 was not heard for " in "".join(controller.err)
        assert len(listener.messages) < COUNT
