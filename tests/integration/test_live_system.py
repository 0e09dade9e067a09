"""Components that can be reset go on over runs in virtual time, and a failure counts only of fresh ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.pool.local import Pool
from riot_bus.system.system_file import RunPace
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

NODE = """
import json, os, sys, threading
import zenoh

ENDPOINT, FATAL, RESETS = sys.argv[1:]
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
session = zenoh.open(config)
total = 0


def reset(sample):
    global total
    total = total if RESETS == "forgets" else 0


def add(sample):
    global total
    total += 1
    if total == int(FATAL) or sample.payload.to_string() == "999":
        os.abort()
    session.put("total", json.dumps({"total": total, "pid": os.getpid()}))


subscribers = [session.declare_subscriber("reset", reset), session.declare_subscriber("in", add)]
threading.Event().wait()
"""
COUNT = 12
LOG = tuple(Message(10**18 + number * 50_000_000, "in", str(number).encode()) for number in range(COUNT))
ADDS = """
[system]
name = "adds"
clock = { reset = { topic = "reset" } }

[external]
topics = ["in"]

[components.add]
command = ["{python}", "node.py", "{endpoint}", "17", "resets"]
inputs = ["in"]
ready = { timeout = 60 }
"""


def totals(folder: Path, cases: list[TestCase], system: str = ADDS) -> tuple[list[Outcome], list[list[object]]]:
    """Return what comes of runs one after the other, and by which processes."""
    (folder / "riot.toml").write_text(system)
    (folder / "node.py").write_text(NODE)
    trial = SystemTrial(RunPace(duration=1.0), ("total:total", "total:pid"))
    with Pool(folder / "riot.toml", 1, keep=folder / "trials") as pool:
        outcomes = [pool.execute(trial, case) for case in cases]
    return outcomes, [sorted(set(one.observed["total:pid"].values)) for one in outcomes]


def test_processes_that_can_be_reset_go_on_over_runs_that_pass(tmp_path: Path) -> None:
    dies = TestCase((*LOG[:-1], LOG[-1].with_(payload=b"999")))
    outcomes, pids = totals(tmp_path, [TestCase(LOG), TestCase(LOG, seed=1), dies, TestCase(LOG), TestCase(LOG)])
    assert [one.verdict for one in outcomes] == [Verdict.PASS, Verdict.PASS, Verdict.FAIL, Verdict.PASS, Verdict.PASS]
    passed = [one for one in outcomes if one.verdict is Verdict.PASS]
    assert [list(one.observed["total:total"].values) for one in passed] == [[*range(1, COUNT + 1)]] * 4
    assert pids[0] == pids[1]
    assert pids[3] == pids[4] != pids[1]


def test_what_fails_after_other_runs_alone_has_not_failed(tmp_path: Path) -> None:
    """Its reset is forgotten, so it dies in the middle of a second run."""
    outcomes, pids = totals(tmp_path, [TestCase(LOG)] * 3, ADDS.replace('"resets"', '"forgets"'))
    assert {one.verdict for one in outcomes} == {Verdict.PASS}
    assert len(set(map(tuple, pids))) == 3


def test_a_reset_that_reaches_nobody_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no component has subscribed to 'rest'"):
        totals(tmp_path, [TestCase(LOG)] * 2, ADDS.replace('topic = "reset"', 'topic = "rest"'))


MONITORS = """
[[monitors]]
kind = "range"
field = "total:total"
max = 10
[[monitors]]
kind = "rate"
topic = "total"
gap = 0.5
"""
"""Of a run of 0.6 s in the time of the log, which takes longer."""


def test_monitors_see_all_runs_in_the_time_of_the_log(tmp_path: Path) -> None:
    short = TestCase(LOG[:10])
    outcomes, pids = totals(tmp_path, [short, short, TestCase(LOG)], ADDS + MONITORS)
    assert [one.verdict for one in outcomes] == [Verdict.PASS, Verdict.PASS, Verdict.FAIL]
    assert [each.monitor for each in outcomes[2].violations] == ["range"]
    assert pids[0] == pids[1] != pids[2], "a failure counts of fresh processes alone"
