"""Components that can be reset go on over runs as time passes, driven by a log or by external components."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.pool.local import Pool
from riot_bus.system.system_file import RunPace
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

NODE = """
import json, os, sys, threading, time
import zenoh

ENDPOINT, WHAT, RESETS = sys.argv[1:]
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
session = zenoh.open(config)
total = 0


def reset(sample=None):
    global total
    total = total if RESETS == "forgets" else 0


def add(sample):
    global total
    total += json.loads(sample.payload.to_bytes())["x"]
    if total > 100:
        os.abort()
    session.put("total", json.dumps({"total": total, "pid": os.getpid()}))


def come_back():
    while True:
        if os.path.exists("flag"):
            os.remove("flag")
            reset()
        time.sleep(0.01)


if WHAT == "drive":
    for _ in range(5):
        session.put("in", json.dumps({"x": 1}))
        time.sleep(0.05)
    session.close()
else:
    subscribers = [session.declare_subscriber(key, take) for key, take in (("reset", reset), ("in", add))]
    threading.Thread(target=come_back, daemon=True).start()
    threading.Event().wait()
"""
SYSTEM = """
[system]
name = "adds"
segments = ["outside", "inside"]
reset = { topic = "reset" }

[external]
topics = ["in"]

[components.drive]
command = ["{python}", "node.py", "{endpoint}", "drive", "{duration}"]
segment = "outside"
external = true
outputs = ["in"]

[components.add]
command = ["{python}", "node.py", "{endpoint}", "add", "resets"]
segment = "inside"
inputs = ["in"]
outputs = ["total"]
ready = { timeout = 60 }
"""
COUNT = 5
LOG = tuple(Message(10**18 + number * 50_000_000, "in", b'{"x": 1}') for number in range(COUNT))
ALONE = SYSTEM[: SYSTEM.index("[components.drive]")] + SYSTEM[SYSTEM.index("[components.add]") :]


def totals(folder: Path, cases: list[TestCase], system: str = SYSTEM) -> tuple[list[Outcome], list[list[object]]]:
    """Return what comes of runs one after the other, and by which processes."""
    (folder / "riot.toml").write_text(system)
    (folder / "node.py").write_text(NODE)
    trial = SystemTrial(RunPace(duration=1.0), ("in:x", "total:total", "total:pid"))
    with Pool(folder / "riot.toml", 1, keep=folder / "trials") as pool:
        outcomes = [pool.execute(trial, case) for case in cases]
    assert not [one.detail for one in outcomes if one.verdict is Verdict.ERROR]
    return outcomes, [sorted(set(one.observed["total:pid"].values)) for one in outcomes]


def seen(outcome: Outcome, name: str = "total:total") -> list[object]:
    """Return the values of a field but for the last: the run may be over before that comes, on a loaded machine."""
    return list(outcome.observed[name].values)[: COUNT - 1]


def test_what_external_components_say_reaches_processes_that_go_on(tmp_path: Path) -> None:
    more, fatal = Injection("in", "x", 3), Injection("in", "x", 60)
    cases = [TestCase(), TestCase(injections=(more,), seed=1), TestCase(injections=(fatal,)), TestCase(), TestCase()]
    outcomes, pids = totals(tmp_path, cases)
    assert [one.verdict for one in outcomes] == [Verdict.PASS, Verdict.PASS, Verdict.FAIL, Verdict.PASS, Verdict.PASS]
    usual = [*range(1, COUNT)]
    assert [seen(outcomes[number]) for number in (0, 3, 4)] == [usual] * 3
    assert seen(outcomes[1]) == [3 * each for each in usual]
    assert seen(outcomes[1], "in:x") == [3] * (COUNT - 1)
    assert outcomes[1].statistics["delivered"] == [COUNT]
    assert pids[0] == pids[1] != pids[2], "a failure counts of fresh processes alone"
    assert pids[3] == pids[4] != pids[2]


ONE_SEGMENT = "\n".join(line for line in ALONE.splitlines() if not line.startswith("segment"))


@pytest.mark.parametrize("system", [ALONE, ONE_SEGMENT], ids=["two segments", "one segment"])
def test_a_log_that_is_played_reaches_processes_that_go_on(tmp_path: Path, system: str) -> None:
    changed = TestCase(LOG, (Injection("in", "x", 3),))
    outcomes, pids = totals(tmp_path, [TestCase(LOG), changed, TestCase(LOG)], system)
    usual = [*range(1, COUNT)]
    assert [seen(one) for one in outcomes] == [usual, [3 * each for each in usual], usual]
    assert pids[0] == pids[1] == pids[2]


def test_what_fails_after_other_runs_alone_has_not_failed(tmp_path: Path) -> None:
    """Its reset is forgotten, so it dies in a second run with 60 in all in each."""
    cases = [TestCase(injections=(Injection("in", "x", 12),), seed=number) for number in range(3)]
    outcomes, pids = totals(tmp_path, cases, SYSTEM.replace('"resets"', '"forgets"'))
    assert {one.verdict for one in outcomes} == {Verdict.PASS}
    assert len(set(map(tuple, pids))) == 3


def test_a_command_may_reset(tmp_path: Path) -> None:
    command = """["sh", "-c", "touch flag; while test -e flag; do sleep 0.01; done; echo {slot} >> slots"]"""
    outcomes, pids = totals(tmp_path, [TestCase()] * 3, SYSTEM.replace('topic = "reset"', f"command = {command}"))
    assert [seen(one) for one in outcomes] == [[*range(1, COUNT)]] * 3
    assert pids[0] == pids[1] == pids[2]
    assert (tmp_path / "slots").read_text() == "0\n0\n"


def test_a_reset_that_does_not_work_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no component has subscribed to 'rest'"):
        totals(tmp_path, [TestCase()] * 2, SYSTEM.replace('topic = "reset"', 'topic = "rest"'))
    with pytest.raises(ConfigError, match="reset: 'false' ended with status 1"):
        totals(tmp_path, [TestCase()] * 2, SYSTEM.replace('topic = "reset"', 'command = ["false"]'))
