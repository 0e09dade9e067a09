from __future__ import annotations

import contextlib
import json
import signal
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from riot_bus.control.remote import ask
from riot_bus.log.reader import LogReader
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.router_process import RouterProcess, failing, riot

pytestmark = pytest.mark.integration

PLAN = """
[[inject]]
topic = "cut/x"
field = "v"
value = 99
"""
running = RouterProcess


@contextlib.contextmanager
def components(router: RouterProcess) -> Iterator[tuple[Puppet, Puppet]]:
    with Puppet(router.endpoints["system"]) as source, Puppet(router.endpoints["unit"]) as sink:
        sink.do("subscribe", key="**")

        def crossed() -> bool:
            source.do("put_texts", key="hello", payloads=["hello"])
            return bool(sink.do("wait", count=1, timeout=0.02))

        assert wait_until(crossed, 60)
        yield source, sink


def arrived(sink: Puppet, key: str, count: int) -> list[bytes]:
    found: list[bytes] = []

    def enough() -> bool:
        samples = sink.do("wait", count=0)
        found[:] = [bytes.fromhex(each["payload"]) for each in samples if each["key"] == key]
        return len(found) >= count

    assert wait_until(enough, 60), found
    return found


def test_a_router_on_sockets_in_a_folder_of_its_user_listens_nowhere_else(tmp_path: Path) -> None:
    folder = tmp_path / "own"
    folder.mkdir(mode=0o700)
    endpoints = {name: f"unixsock-stream/{folder / name}" for name in ("system", "unit")}
    with running(endpoints=endpoints, cwd=tmp_path) as router:
        router.endpoints = endpoints
        with components(router):
            ask(endpoints["system"], None, "record/start")
        listening = [each.laddr for each in psutil.Process(router.process.pid).net_connections("inet")]
        assert not listening
        (log,) = tmp_path.glob("*.mcap")
        assert log.stat().st_mode & 0o777 == 0o600


def test_the_sockets_of_a_router_that_was_killed_are_removed_by_the_next_one(tmp_path: Path) -> None:
    own = {"TMPDIR": str(tmp_path)}
    with running(environment=own) as router:
        (used,) = tmp_path.iterdir()
        with running(environment=own) as killed:
            (left,) = set(tmp_path.iterdir()) - {used}
            assert killed.end(signal.SIGKILL)[0] == -signal.SIGKILL
        assert any(each.is_socket() for each in left.iterdir())
        with running(environment=own) as third:
            assert not left.exists()
            assert third.end(signal.SIGTERM)[0] == 0
        assert list(tmp_path.iterdir()) == [used]
        with components(router):
            pass
        assert router.end(signal.SIGTERM)[0] == 0
    assert list(tmp_path.iterdir()) == []


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

        assert wait_until(written, 60, interval=0.05)
        router.process.kill()
        router.process.wait(60)
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
        code, err = failing([f"--segment=a={router.endpoints['unit']}", "--segment=b=tcp/127.0.0.1:0"])
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
        code, err = failing(arguments)
        assert (code, text in err, "Traceback" in err) == (2, True, False), err


def test_interceptor_of_a_file_that_raises_is_in_the_status_with_name_line_and_count(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("class Mine:\n    def message(self, event):\n        raise RuntimeError('on purpose')\n")
    with running(f"--interceptor={file}", "--intercept=cut/**") as router, components(router) as (source, sink):
        source.do("put_texts", key="cut/x", payloads=["same", "same"], congestion="BLOCK")
        assert arrived(sink, "cut/x", 2) == [b"same", b"same"]
        (interceptor,) = ask(router.endpoints["unit"], None, "status")["interceptors"]
    assert (interceptor["name"], interceptor["errors"], interceptor["place"]) == ("Mine", 2, f"{file}:3")
    assert interceptor["error"] == "RuntimeError: on purpose"


def test_shipped_interceptors_are_named_with_options_and_what_they_select_is_intercepted() -> None:
    with running("--interceptor", "drop every=2 select=cut/**") as router, components(router) as (source, sink):
        assert router.ready.endswith("intercepting cut/**")
        texts = [str(number) for number in range(10)]
        source.do("put_texts", key="cut/x", payloads=texts, congestion="BLOCK")
        assert len(arrived(sink, "cut/x", 5)) == 5
        status = ask(router.endpoints["system"], None, "status")
    assert status["interceptors"][0]["conditions"] == {"select": "cut/**"}
    assert (status["counts"]["cut/x"]["dropped"], status["counts"]["cut/x"]["balanced"]) == (5, True)


def test_settings_of_riot_toml_are_used_and_replaced_by_options(tmp_path: Path) -> None:
    (tmp_path / "riot.toml").write_text(
        """
[router]
name = "lab"
intercept = ["cut/**"]

[router.segments.left]
listen = ["tcp/127.0.0.1:0"]

[router.segments.right]
listen = ["tcp/127.0.0.1:0"]

[[router.interceptors]]
use = "drop"
every = 1
select = "gone"
"""
    )
    with running("--name=other", "--format=json", cwd=tmp_path, segments=False) as router:
        ready = json.loads(router.ready)
        assert (ready["router"], ready["intercepted"]) == ("other", ["cut/**", "gone"])
        assert list(ready["endpoints"]) == ["left", "right"]
        code, out, err = router.end(signal.SIGTERM)
    ended = json.loads(out)
    assert (code, err) == (0, "")
    assert (ended["event"], [each["name"] for each in ended["interceptors"]]) == ("ended", ["drop"])


def test_environment_of_a_segment_and_hints_for_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "riot.toml").write_text("[router.segments.lab]\nlisten = ['tcp/0.0.0.0:7450']\n")
    code, out, err = riot("router", "env", "lab", "--host", "robot.local", cwd=tmp_path)
    assert (code, err) == (0, "")
    assert "export RMW_IMPLEMENTATION=rmw_zenoh_cpp" in out
    assert 'connect/endpoints=["tcp/robot.local:7450"]' in out
    code, out, err = riot("router", "env", "lab", "--flavour=zenoh", "--cfg=timestamping/enabled=true", cwd=tmp_path)
    file = tmp_path / "zenoh-lab.json5"
    assert f"export ZENOH_CONFIG={file}" in out
    assert json.loads(file.read_text())["timestamping"] == {"enabled": True}
    assert file.stat().st_mode & 0o077 == 0
    code, out, err = riot("router", "env", "lap", cwd=tmp_path)
    assert (code, out) == (2, "")
    assert "did you mean 'lab'?" in err
