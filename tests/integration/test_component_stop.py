"""How components are ended: by a command of riot.toml that asks them to, in trials on a real bus."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from riot_bus.log.writer import LogWriter
from riot_bus.pool.local import Pool
from riot_bus.processes.launcher import Launcher
from riot_bus.system.system_file import RunPace
from riot_bus.trial import processes
from riot_bus.trial.context import open_system
from riot_bus.trial.setup import TrialSetup
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.trial.unit_trial import UnitTrial
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import TestCase, Verdict

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

NODE = """
import json, os, signal, sys, threading
import zenoh

ended = threading.Event()
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda *_: ended.set())
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
subscribers = [
    session.declare_subscriber("ask", lambda sample: session.put("answer", sample.payload)),
    session.declare_subscriber("end", lambda sample: ended.set()),
]
while not ended.wait(0.05):
    pass
with open("told", "a") as told:
    told.write(sys.argv[2] + "\\n")
if sys.argv[2] == "crash":
    os.kill(os.getpid(), signal.SIGSEGV)
if sys.argv[2] == "stay":
    threading.Event().wait()
session.close()
"""
SYSTEM = """
[components.part]
command = ["{{python}}", "node.py", "{{endpoint}}", "{how}"]
inputs = ["ask"]
outputs = ["answer"]
ready = {{ timeout = 60 }}
stop = {stop}
"""
BY_SIGNAL = '["sh", "-c", "echo asked $GAIN >> told; kill -INT {pid}"]'


def write(folder: Path, stop: str = BY_SIGNAL, how: str = "ended") -> Path:
    (folder / "node.py").write_text(NODE)
    path = folder / "riot.toml"
    path.write_text(SYSTEM.format(stop=stop, how=how) + 'env = { GAIN = "2" }\n[unit.part]\nlog = "nominal.mcap"\n')
    with LogWriter(folder / "nominal.mcap") as log:
        log.write(Message(1, "ask", b"x"))
    return path


@contextmanager
def ready_setup(path: Path) -> Iterator[TrialSetup]:
    folder = path.parent / "trial"
    folder.mkdir()
    with Launcher() as launcher, TrialSetup(open_system(path), launcher, folder, segments=["system"]) as made:
        made.start("part", seed=0)
        made.readiness.wait_subscribed("part", ["ask"])
        yield made


def told(path: Path) -> list[str]:
    found = path.with_name("told")
    return found.read_text().splitlines() if found.exists() else []


def test_a_command_asks_a_component_to_end(tmp_path: Path) -> None:
    path = write(tmp_path)
    with ready_setup(path) as one:
        assert told(path) == []
        one.processes.end(["part"])
        assert one.processes.started["part"].status == 0
    assert told(path) == ["asked 2", "ended"]  # once, though the trial ended later


def test_a_command_may_ask_over_the_bus(tmp_path: Path) -> None:
    (tmp_path / "stop.py").write_text(
        "import json, sys, zenoh\n"
        "config = zenoh.Config()\n"
        "config.insert_json5('mode', '\"client\"')\n"
        "config.insert_json5('connect/endpoints', json.dumps([sys.argv[1]]))\n"
        "with zenoh.open(config) as session:\n"
        "    session.put('end', b'', congestion_control=zenoh.CongestionControl.BLOCK)\n"
    )
    path = write(tmp_path, '["{python}", "stop.py", "{endpoint}"]')
    with ready_setup(path) as one:
        one.processes.end(["part"])
        assert one.processes.started["part"].status == 0
    assert told(path) == ["ended"]


@pytest.mark.parametrize(
    ("stop", "how", "words"),
    [
        ('["sh", "-c", "echo no pid file >&2; exit 3"]', "ended", "'sh' ended with status 3; .*no pid file"),
        ('["no-such-program"]', "ended", "'no-such-program' cannot be executed: .*no-such-program"),
        ('["sleep", "93.5"]', "ended", "'sleep' was executed 0.5 s ago, and has not ended itself"),
        (BY_SIGNAL, "stay", "'sh' was executed 0.5 s ago, and the component still runs"),
    ],
)
def test_a_component_that_does_not_end_is_killed_and_that_is_told(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    stop: str,
    how: str,
    words: str,
) -> None:
    monkeypatch.setattr("riot_bus.trial.processes._ENDED_WITHIN_S", 0.5)
    processes._log_unstopped.cache_clear()
    with ready_setup(write(tmp_path, stop, how)) as one:
        begin = time.monotonic()
        one.processes.end(["part"])
        assert one.processes.started["part"].status == -signal.SIGKILL
        assert time.monotonic() - begin < 10
    (line,) = caplog.messages
    assert line.startswith("component 'part' is killed: its stop command ")
    assert re.search(f"(?s){words}", line)


@pytest.mark.parametrize("how", ["ended", "crash"])
def test_what_happens_while_a_component_ends_is_no_failure(tmp_path: Path, how: str) -> None:
    path = write(tmp_path, how=how)
    case = TestCase((Message(1, "ask", b"x"),))
    with Pool(path, 1, keep=tmp_path / "trials") as pool:
        alone = pool.execute(UnitTrial("part"), case)
        assert (alone.verdict, told(path)) == (Verdict.PASS, ["asked 2", how]), alone
        whole = pool.execute(SystemTrial(RunPace(duration=1.0)), case)
        assert (whole.verdict, told(path)) == (Verdict.PASS, ["asked 2", how] * 2), whole
