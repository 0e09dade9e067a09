from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.monitors.mined import Mined, MinedRule
from riot_bus.pool.nominal import in_system_of, needs_baseline, why_not_told
from riot_bus.processes.activity import STILL
from riot_bus.processes.python_report import ThreadStack
from riot_bus.trial.baseline import UNKNOWN, Baseline, NominalTrial
from riot_bus.trial.context import open_system
from riot_bus.vocabulary.message import Message

COUNT = MinedRule("count", "state", low=(3,), high=(3,))
VALUE = MinedRule("value", "state", "x", (0.0, 1.0, 2.0), (0.1, 1.1, 2.1))
KNOWN = Baseline(
    trials=4,
    log_answers={"state": 30, "late": 2},
    probe_answers={"state": 3},
    at_rest={"wait": 1},
    threads={"main": 1, "worker": 1},
    main_ends=False,
    ends=False,
    mined=Mined((COUNT,)),
    alarms=("growth of u: files",),
)


@pytest.mark.parametrize(
    ("monitor", "signature"),
    [
        ("exit", "exit of u: status 0 by sys.exit in main"),
        ("exit", "exit of u: the main thread has ended, though the process has not"),
        ("exit", "exit of u: a thread has ended: main, worker"),
        ("silent", "silent of u: nothing on state"),
        ("silent", "silent of u: nothing on late, state"),
        ("hang", "hang of u"),
        ("hang", "hang of u: in spin"),
        ("growth", "growth of u: memory"),
        ("mined", "mined count of state"),
    ],
)
def test_what_nominal_runs_do_not_show_can_be_told(monitor: str, signature: str) -> None:
    assert needs_baseline(monitor)
    assert why_not_told(KNOWN, monitor, signature) == ""
    assert why_not_told(UNKNOWN, monitor, signature) == "nominal runs of the whole system are not known"


@pytest.mark.parametrize(
    ("monitor", "signature", "words"),
    [
        ("exit", "exit of u: a thread has ended: timer", "have no thread of timer"),
        ("silent", "silent of u: nothing on shared, state", "other components publish on shared"),
        ("silent", "silent of u: nothing on late", "does not answer nominal input on late"),
        ("hang", "hang of u: in spin, wait", "threads stand in wait, too"),
        ("growth", "growth of u: files", "show the same"),
        ("mined", "mined value of state:x", "the rule does not hold"),
    ],
)
def test_what_they_show_or_do_not_have_cannot(monitor: str, signature: str, words: str) -> None:
    assert words in why_not_told(KNOWN, monitor, signature)


def test_the_end_of_a_unit_that_ends_in_nominal_runs_is_no_failure() -> None:
    ending = Baseline(trials=4)
    assert "ends by itself" in why_not_told(ending, "exit", "exit of u: status 0")
    assert "main thread ends" in why_not_told(ending, "exit", "exit of u: the main thread has ended, though")


def test_a_crash_needs_no_nominal_runs() -> None:
    assert not any(map(needs_baseline, ("crash", "limit", "range", "never")))


def answer(number: int, x: float) -> Message:
    return Message(10**18 + number, "state", json.dumps({"x": x}).encode(), encoding="application/json")


def test_expected_is_what_the_unit_does_alone_and_in_all_runs_of_the_system(tmp_path: Path) -> None:
    path = tmp_path / "riot.toml"
    path.write_text('[components.u]\ncommand = ["u"]\ninputs = ["cmd"]\noutputs = ["state"]\n[unit.u]\n')
    alone = Baseline(
        trials=3,
        log=(Message(1, "cmd", b"{}"),),
        probe=(Message(1, "cmd", b"{}"),),
        probe_answers={"state": 3, "shared": 1},
        mined=Mined((COUNT, VALUE), 6, 0, 8),
    )
    stacks = (ThreadStack(("wait", "main"), ""),)

    def run(x: float) -> NominalTrial:
        outputs = (answer(0, 7.0), *(answer(number, number + x) for number in range(3)))
        probed = {"state": 3, "of_others": 5}
        return NominalTrial({"state": 4}, probed, stacks, False, None, outputs=outputs, probed=1)

    found = in_system_of(alone, {"state": 30}, [run(0.05), run(0.5)], context=open_system(path), idle=STILL)
    assert (found.trials, found.probe, found.log) == (2, alone.probe, alone.log)
    assert (found.log_answers, found.probe_answers) == ({"state": 30}, {"state": 3})
    assert (found.at_rest, found.threads, found.ends) == ({"wait": 1}, {"main": 1}, False)
    assert found.mined.rules == (COUNT,)
    assert found.mined.dropped == ("value of state:x",)
    assert (found.mined.trials, found.mined.alarms, found.mined.held_out) == (6, 1, 2)
