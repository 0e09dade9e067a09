from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from riot_bus.chain.steps.reproduce import play_again, reproduce
from riot_bus.events import TrialFinished
from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.records import FindingRecord, MinimalRecord
from riot_bus.log.writer import LogWriter
from riot_bus.trial.baseline import Baseline
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError
from riot_bus.vocabulary.trial import Outcome, TestCase
from tests.unit.chain.machine import (
    HANG,
    OTHER,
    SYSTEM,
    Bench,
    bench,
    command,
    panel,
    rated,
    said,
    write_finding,
    write_minimal,
)


def test_a_finding_that_fails_each_time_is_still_failing(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_finding(one, [command("step", 3.0), command("step", -5.0, 1)], {})
    found = reproduce(one.workspace, one.folder)
    assert (found.answer, found.failed, found.trials, found.log) == ("still failing", 3, 3, "failure.mcap")
    assert found.detail == "still busy"
    assert [case.seed for case in one.machine.executed] == [0, 1, 2]
    assert [event.step for event in one.told(TrialFinished)] == ["reproduce"] * 3


def test_the_minimal_log_is_played_if_there_is_one(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    assert reproduce(one.workspace, one.folder, times=5).log == "minimal.mcap"
    assert len(one.machine.executed) == 5


def test_no_probe_follows_a_minimal_log_that_fails_without(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    MinimalRecord.load(one.folder).model_copy(update={"unprobed": True}).save(one.folder)
    reproduce(one.workspace, one.folder, times=2)
    assert [case.unprobed for case in one.machine.executed] == [True, True]


def test_answers_never_come_from_the_store(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    reproduce(one.workspace, one.folder)
    reproduce(one.workspace, one.folder)
    assert len(one.machine.executed) == 6


def test_a_finding_that_never_fails_is_fixed(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one, speed=5.0)
    found = reproduce(one.workspace, one.folder)
    assert (found.answer, found.failed, found.detail) == ("fixed", 0, "")
    assert found.missed < 0.06


def described(one: Bench, **changes: object) -> None:
    FindingRecord.load(one.folder).model_copy(update=changes).save(one.folder)


SILENT = {"monitor": "silent", "signature": "silent of drive: nothing on state"}
MUTE = "exit, silent, growth and mined: 1 of 3 trials with 60 nominal messages did not pass: crash in drive: f"
WORKS = Baseline(trials=3, log_answers={"state": 9}, probe_answers={"state": 4}, main_ends=False, ends=False)


def test_what_only_a_nominal_log_tells_is_not_fixed_without_one(tmp_path: Path) -> None:
    one = bench(tmp_path, alone=WORKS)
    write_minimal(one, speed=5.0)
    described(one, **SILENT)
    with pytest.raises(
        InconclusiveError, match="nothing here shows whether 'silent' occurs: there is no nominal log"
    ) as raised:
        reproduce(one.workspace, one.folder)
    assert "name one in riot.toml" in str(raised.value)
    one.workspace.nominal_log()
    assert reproduce(one.workspace, one.folder).answer == "fixed"


@pytest.mark.parametrize(
    ("monitor", "place"),
    [
        ("exit", "of drive: status 0"),
        ("silent", "of drive: nothing on state"),
        ("growth", "of drive: memory"),
        ("mined", "value of state:x"),
        ("hang", "of drive: in take"),
    ],
)
def test_nothing_is_fixed_where_nominal_trials_did_not_pass(tmp_path: Path, monitor: str, place: str) -> None:
    one = bench(tmp_path, alone=Baseline(mute=(MUTE,)))
    write_minimal(one, speed=5.0)
    one.workspace.nominal_log()
    described(one, monitor=monitor, signature=f"{monitor} {place}")
    with pytest.raises(
        InconclusiveError, match=f"nothing here shows whether '{monitor}' occurs: .*1 of 3 trials.*crash in drive: f"
    ):
        reproduce(one.workspace, one.folder)


@pytest.mark.parametrize(
    ("monitor", "place", "why"),
    [
        ("exit", "of drive: status 0", "the unit ends by itself in nominal trials"),
        ("silent", "of drive: nothing on other", "in nominal trials the unit does not answer nominal input on other"),
        ("mined", "value of state:x", "the rule does not hold for the unit's answers in nominal trials"),
        ("hang", "of drive: in take", "in nominal trials threads stand in take, too"),
    ],
)
def test_what_nominal_trials_show_otherwise_now_is_not_fixed(
    tmp_path: Path, monitor: str, place: str, why: str
) -> None:
    one = bench(tmp_path, alone=replace(WORKS, ends=True, at_rest={"take": 1}))
    write_minimal(one, speed=5.0)
    one.workspace.nominal_log()
    described(one, monitor=monitor, signature=f"{monitor} {place}")
    with pytest.raises(InconclusiveError, match=f"nothing here shows whether '{monitor}' occurs: {why}"):
        reproduce(one.workspace, one.folder)


def test_a_thread_that_hangs_is_told_by_failing_alone_where_there_is_no_nominal_log(tmp_path: Path) -> None:
    place = "hang of drive: in take"
    one = bench(tmp_path)
    plain = one.machine.outcome

    def outcome(case: TestCase, failed: bool, **more: Any) -> Outcome:
        found = plain(case, failed, **more)
        return replace(found, violations=tuple(replace(each, signature=place) for each in found.violations))

    one.machine.outcome = outcome  # type: ignore[method-assign]
    write_minimal(one)
    described(one, signature=place)
    assert reproduce(one.workspace, one.folder).answer == "still failing"
    write_minimal(one, speed=5.0)
    described(one, signature=place)
    with pytest.raises(InconclusiveError, match="nothing here shows whether 'hang' occurs: there is no nominal log"):
        reproduce(one.workspace, one.folder)


MONITORS = """
[[monitors]]
kind = "range"
field = "state:speed"
min = 0

[[monitors]]
kind = "never"
when = "state where speed > 7"

[[monitors]]
kind = "count"
output = "state"
input = "command"
low = 0
high = 1
"""
RANGE = {"monitor": "range", "component": "state:speed", "signature": "range of state:speed"}
NEVER = {"monitor": "never", "component": "state", "signature": "never state where speed > 7"}
COUNT_OF = {"monitor": "count", "component": "state", "signature": "count of state for command"}


@pytest.mark.parametrize(
    ("finding", "name"),
    [(RANGE, "Range state:speed"), (NEVER, "Never state where speed > 7"), (COUNT_OF, "Ratio state, command")],
    ids=["range", "never", "count"],
)
@pytest.mark.parametrize("broken", [False, True])
def test_a_monitor_that_had_nothing_to_judge_has_not_seen_it_fixed(
    tmp_path: Path, finding: dict[str, str], name: str, *, broken: bool
) -> None:
    why, blind = "no message of 'state' came", [True]
    one = bench(tmp_path, SYSTEM + MONITORS)
    plain = one.machine.outcome

    def outcome(case: TestCase, failed: bool, **more: Any) -> Outcome:
        found = plain(case, failed, **more)
        lines = ["Rate other: no message came", f"{name}: {why}"] if case.seed or all(blind) else []
        return replace(found, detail="; ".join(lines)) if broken else replace(found, statistics={"unseen": lines})

    one.machine.outcome = outcome  # type: ignore[method-assign]
    write_minimal(one, speed=5.0)
    described(one, **finding)
    with pytest.raises(
        InconclusiveError, match=re.escape(f"nothing here shows whether '{finding['monitor']}' occurs: {name}: {why}")
    ):
        reproduce(one.workspace, one.folder)
    blind.append(False)
    assert reproduce(one.workspace, one.folder).answer == "fixed"


def test_a_monitor_that_riot_toml_has_no_more_has_not_seen_it_fixed(tmp_path: Path) -> None:
    one = bench(tmp_path, SYSTEM + '[[monitors]]\nkind = "range"\nfield = "state:speeds"\nmin = 0\n')
    write_minimal(one, speed=5.0)
    described(one, **RANGE)
    with pytest.raises(InconclusiveError, match=r"riot\.toml has no such monitor of state:speed any more"):
        reproduce(one.workspace, one.folder)
    described(one, monitor="somebody's")  # of which nothing is known
    assert reproduce(one.workspace, one.folder).answer == "fixed"


def test_one_that_fails_in_most_trials_is_still_failing(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=lambda case: case.seed == 1)
    write_minimal(one)
    found = reproduce(one.workspace, one.folder)
    assert (found.answer, found.failed, found.trials) == ("still failing", 2, 3)


@pytest.mark.parametrize("mended", [False, True])
def test_what_fails_three_times_in_ten_takes_more_trials(tmp_path: Path, *, mended: bool) -> None:
    one = bench(tmp_path, wrong=lambda case: not mended and case.seed % 4 != 3)
    write_minimal(one, speed=5.0 if mended else -5.0)
    rated(one, 3, 10)
    found = reproduce(one.workspace, one.folder)
    assert found.answer == ("fixed" if mended else "still failing")
    assert 3 <= found.trials <= 15
    assert (found.failed > 0) is not mended
    if mended:
        assert found.trials >= 9
        assert found.missed < 0.1


def test_what_comes_more_seldom_than_before_is_neither(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=lambda case: case.seed != 0)
    write_minimal(one)
    rated(one, 4, 4)
    with pytest.raises(
        InconclusiveError, match=r"1 of \d+ trials of minimal\.mcap fail as before, where about 9\d% did"
    ):
        reproduce(one.workspace, one.folder)


def test_so_many_trials_as_asked_for_and_no_answer_if_they_do_not_decide(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=lambda case: True)
    write_minimal(one)
    rated(one, 3, 10)
    with pytest.raises(InconclusiveError, match=r"0 of 4 trials"):
        reproduce(one.workspace, one.folder, times=4)
    assert len(one.machine.executed) == 4


def test_failing_in_another_way_is_inconclusive(tmp_path: Path) -> None:
    one = bench(tmp_path, other=lambda case: True)
    write_minimal(one)
    with pytest.raises(InconclusiveError, match=r"0 of 3 trials.*others fail differently: crash in drive"):
        reproduce(one.workspace, one.folder)


def test_trials_that_cannot_be_carried_out_are_no_answer(tmp_path: Path) -> None:
    one = bench(tmp_path, broken=lambda case: case.seed == 2)
    write_minimal(one)
    with pytest.raises(EnvironmentFaultError, match="no port"):
        reproduce(one.workspace, one.folder)


def activated(one: Bench) -> None:
    write_minimal(one)
    ActivationRecord(found={}, runs=1, best_distance=None).save(one.folder)
    with LogWriter(one.folder / "activation.mcap") as writer:
        for message in panel(0):
            writer.write(message.with_(payload=message.payload.replace(b'"knob": ', b'"knob": -')))


def test_the_whole_system_gets_the_external_messages_alone(tmp_path: Path) -> None:
    one = bench(tmp_path)
    activated(one)
    found = reproduce(one.workspace, one.folder, whole_system=True)
    assert (found.answer, found.failed, found.log) == ("still failing", 3, "activation.mcap")
    assert all(said(message)["knob"] < 0 for case in one.machine.executed for message in case.messages)


def test_without_an_activation_the_whole_system_has_nothing_to_get(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    with pytest.raises(ConfigError, match=r"no activation\.mcap"):
        reproduce(one.workspace, one.folder, whole_system=True)
    activated(one)
    (one.folder / "activation.mcap").unlink()
    with pytest.raises(ConfigError, match=r"no activation\.mcap"):
        reproduce(one.workspace, one.folder, whole_system=True)


def test_what_runs_of_the_system_cannot_tell_is_not_fixed(tmp_path: Path) -> None:
    one = bench(tmp_path, known=Baseline(trials=4, alarms=(HANG.signature,)))
    write_minimal(one)
    ActivationRecord(found={"panel:knob": 1.0}, runs=1, best_distance=0.0).save(one.folder)
    with LogWriter(one.folder / "activation.mcap") as log:
        log.write(panel(0)[0])
    with pytest.raises(InconclusiveError, match=r"not tested in the whole system: nominal runs .* show the same"):
        reproduce(one.workspace, one.folder, whole_system=True)
    assert one.machine.executed == []


def test_a_log_that_always_fails_otherwise_has_an_answer_of_its_own(tmp_path: Path) -> None:
    one = bench(tmp_path, other=lambda case: True)
    write_minimal(one)
    found = play_again(one.workspace, one.folder)
    assert (found.answer, found.failed, found.trials, found.others) == ("failing otherwise", 0, 3, (OTHER,))


def test_one_that_fails_otherwise_now_and_then_is_not_decided(tmp_path: Path) -> None:
    one = bench(tmp_path, other=lambda case: True, wrong=lambda case: case.seed == 1)
    write_minimal(one)
    found = play_again(one.workspace, one.folder)
    assert (found.answer, found.others) == ("not decided", (OTHER,))
