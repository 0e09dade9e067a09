from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from riot_bus.bus.runtime import free_endpoint, wait_until
from riot_bus.log.reader import LogReader
from tests.integration.bus_puppet import Puppet

pytestmark = pytest.mark.integration

APP = """
import sys, typer
from riot_bus.cli.router import router
from riot_bus.errors import RiotError

app = typer.Typer()
app.command()(router)
try:
    app(standalone_mode=False)
except RiotError as error:
    print(error, file=sys.stderr)
    sys.exit(error.exit_code)
"""
PLAN = """
[[inject]]
topic = "cut/x"
field = "v"
value = 99
"""
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}


class Router:
    """A running `riot router`."""

    def __init__(self, arguments: Sequence[str]) -> None:
        self.endpoints = {"system": free_endpoint(), "unit": free_endpoint()}
        segments = [f"--segment={name}={endpoint}" for name, endpoint in self.endpoints.items()]
        self.process = subprocess.Popen(
            [sys.executable, "-c", APP, *segments, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=ENVIRONMENT,
        )
        assert self.process.stdout is not None
        self.ready = self.process.stdout.readline().strip()

    def end(self, number: int) -> tuple[int, str, str]:
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=20)
        return self.process.returncode, out, err


@contextlib.contextmanager
def running(*arguments: str) -> Iterator[Router]:
    router = Router(arguments)
    try:
        yield router
    finally:
        router.process.kill()
        router.process.communicate(timeout=10)


@contextlib.contextmanager
def components(router: Router) -> Iterator[tuple[Puppet, Puppet]]:
    with Puppet(router.endpoints["system"]) as source, Puppet(router.endpoints["unit"]) as sink:
        sink.do("subscribe", key="**")

        def crossed() -> bool:
            source.do("put_texts", key="hello", payloads=["hello"])
            return bool(sink.do("wait", count=1, timeout=0.02))

        assert wait_until(crossed, 10)
        yield source, sink


def failing(*arguments: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-c", APP, *arguments],
        capture_output=True,
        text=True,
        timeout=30,
        env=ENVIRONMENT,
        check=False,
    )
    return done.returncode, done.stderr


def arrived(sink: Puppet, key: str, count: int) -> list[bytes]:
    found: list[bytes] = []

    def enough() -> bool:
        samples = sink.do("wait", count=0)
        found[:] = [bytes.fromhex(each["payload"]) for each in samples if each["key"] == key]
        return len(found) >= count

    assert wait_until(enough, 10), found
    return found


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_router_runs_until_a_signal_and_prints_a_table(number: int, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    with running("--intercept=cut/**", f"--inject={plan}") as router:
        where = ", ".join(f"segment {name} {endpoint}" for name, endpoint in router.endpoints.items())
        assert router.ready == f"ready: {where}; intercepting cut/**, cut/x"
        with components(router) as (source, sink):
            source.do("put_texts", key="cut/x", payloads=['{"v": 1}'], congestion="BLOCK")
            source.do("put_texts", key="cut/y", payloads=['{"v": 1}'], congestion="BLOCK")
            assert json.loads(arrived(sink, "cut/x", 1)[0]) == {"v": 99}
            assert arrived(sink, "cut/y", 1) == [b'{"v": 1}']
        code, out, err = router.end(number)
        table = [line.split() for line in out.splitlines()]
        assert table == [
            ["topic", "received", "changed", "added", "forwarded", "dropped", "lost", "held", "recorded", "unrecorded"],
                ["cut/x", "1", "1", "0", "1", "0", "0", "0", "0", "0"],
                ["cut/y", "1", "0", "0", "1", "0", "0", "0", "0", "0"],
        ]
        assert (code, err) == (0, "")


def test_recording_survives_a_kill_with_originals_and_provenance(tmp_path: Path) -> None:
    plan, log = tmp_path / "plan.toml", tmp_path / "out.mcap"
    plan.write_text(PLAN)
    with running(f"--inject={plan}", f"--record={log}", "--seed=7") as router, components(router) as (source, sink):
        source.do("put_texts", key="cut/x", payloads=['{"v": 1}'], congestion="BLOCK")
        source.do("put_texts", key="free", payloads=["native"], congestion="BLOCK")
        arrived(sink, "cut/x", 1)

        def written() -> bool:
            with LogReader(log) as reader:
                keys = {message.key for message in reader.messages()}
            return {"cut/x", "free"} <= keys

        assert wait_until(written, 10, interval=0.05)
        router.process.kill()
        router.process.wait(10)
    with LogReader(log) as reader:
        (delivered,) = [message for message in reader.messages() if message.key == "cut/x"]
        (original,) = list(reader.originals())
        provenance = list(reader.provenance())
        assert reader.metadata["seed"] == "7"
    assert json.loads(original.payload) == {"v": 1}
    assert json.loads(delivered.payload) == {"v": 99}
    assert (original.sequence, original.segment) == (delivered.sequence, "system")
    assert {(entry.role, entry.changes[0].action, entry.changes[0].after) for entry in provenance} == {
        ("original", "set", 99),
        ("delivered", "set", 99),
    }


def test_user_interceptor_that_raises_is_reported_and_traffic_goes_on(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("class Mine:\n    def message(self, event):\n        raise RuntimeError('on purpose')\n")
    with running(f"--interceptor={file}", "--intercept=cut/**") as router:
        with components(router) as (source, sink):
            source.do("put_texts", key="cut/x", payloads=["same"], congestion="BLOCK")
            assert arrived(sink, "cut/x", 1) == [b"same"]
        code, _, err = router.end(signal.SIGTERM)
    assert code == 0
    assert "interceptor Mine raised 1 times" in err
    assert "on purpose" in err


def test_port_in_use_exits_with_4() -> None:
    with running() as router:
        code, err = failing(f"--segment=a={router.endpoints['unit']}", "--segment=b=tcp/127.0.0.1:0")
    assert code == 4
    assert f"{router.endpoints['unit']} is in use" in err
    assert "Traceback" not in err


def test_wrong_options_exit_with_2(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("class Mine:\n    def message(self, event):\n        pass\n")
    free = ["--segment=a=tcp/127.0.0.1:0", "--segment=b=tcp/127.0.0.1:0"]
    for arguments, text in (
        (["--segment=nonsense"], "'nonsense' is not a segment"),
        ([*free, "--intercept=a//b"], "'a//b' is not a key expression"),
        ([*free, f"--interceptor={file}"], "--intercept KEYEXPR"),
        ([*free, "--type=odom"], "TOPIC=TYPE"),
    ):
        code, err = failing(*arguments)
        assert (code, text in err, "Traceback" in err) == (2, True, False), err
