from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from riot_bus.chain.logs import FailingLog
from riot_bus.chain.minimize import minimize
from riot_bus.findings.records import FindingRecord, MinimalRecord, ProportionRecord
from riot_bus.findings.steps import find_step
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import COUNT, Bench, always, bench, command, write_finding


def failing(one: Bench, *bad: int) -> None:
    messages = [command("step", -5.0 if number in bad else 3.0, number) for number in range(COUNT)]
    write_finding(one, messages, {number: command("step", 3.0, number) for number in bad})


def test_the_one_message_that_is_needed_is_kept_with_its_original(tmp_path: Path) -> None:
    one = bench(tmp_path)
    failing(one, 41)
    record = one.workspace.carry_out(find_step("minimize"), one.folder)
    assert isinstance(record, MinimalRecord)
    assert (record.before, record.kept, record.topics, record.one_minimal) == (COUNT, (41,), ("command",), True)
    assert MinimalRecord.load(one.folder) == record
    assert record.trials == len(one.machine.executed) < 20
    log = FailingLog.load(one.folder / "minimal.mcap", registry=one.workspace.context.registry)
    assert [message.sequence for message in log.messages] == [41]
    assert list(log.originals) == [41]
    assert record.summary == f"{COUNT} messages -> 1: command ({record.trials} trials)"


def test_of_two_sufficient_messages_one_is_kept(tmp_path: Path) -> None:
    one = bench(tmp_path)
    failing(one, 10, 50)
    assert minimize(one.run(), one.folder).kept in ((10,), (50,))


def test_messages_that_are_needed_together_are_kept_together(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=lambda messages: 1 if {3, 30} <= {each.sequence for each in messages} else None)
    failing(one, 3, 30)
    assert minimize(one.run(), one.folder).kept == (3, 30)


def test_a_unit_that_fails_without_input_needs_no_message(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=always)
    failing(one, 5)
    record = minimize(one.run(), one.folder)
    assert record.kept == ()
    assert "none (it fails without any input)" in record.summary


def test_what_fails_because_messages_are_missing_is_another_cause(tmp_path: Path) -> None:
    """The unit also fails, at the same place, when the first message is missing, whatever else there is."""

    def fails(messages: Sequence[Message]) -> int | None:
        numbers = [message.sequence for message in messages]
        modified = 41 in numbers and messages[numbers.index(41)] != command("step", 3.0, 41)
        return 1 if modified or 0 not in numbers else None

    one = bench(tmp_path, fails=fails)
    failing(one, 41)
    assert minimize(one.run(), one.folder).kept != (0, 41)  # nothing is known of the nominal log
    (one.folder / "minimal.json").unlink(missing_ok=True)
    known = FindingRecord.load(one.folder)
    passes = ProportionRecord(value=0.0, low=0.0, high=0.6, count=0, total=4)
    known.model_copy(update={"nominal": passes}).save(one.folder)
    assert minimize(one.run(), one.folder).kept == (0, 41)


def test_other_failures_do_not_count(tmp_path: Path) -> None:
    one = bench(tmp_path, other=lambda case: len(case.messages) < 30)
    failing(one, 41)
    assert len(minimize(one.run(), one.folder).kept) == 30


def test_a_log_that_does_not_fail_again_is_inconclusive(tmp_path: Path) -> None:
    one = bench(tmp_path)
    failing(one)
    with pytest.raises(InconclusiveError, match="does not fail with this signature"):
        minimize(one.run(), one.folder)
    assert not MinimalRecord.exists(one.folder)


def test_one_wrong_answer_leaves_more_messages_and_they_fail(tmp_path: Path) -> None:
    """What holds today: nothing is asked twice, so a false pass is believed and costs messages, never the failure."""
    one = bench(tmp_path, wrong=lambda case: len(case.messages) == 1 and case.messages[0].sequence == 41)
    failing(one, 41)
    kept = minimize(one.run(), one.folder).kept
    assert 41 in kept
    assert len(kept) > 1


def test_trials_that_cannot_be_carried_out_end_the_step(tmp_path: Path) -> None:
    one = bench(tmp_path, broken=lambda case: True)
    failing(one, 41)
    with pytest.raises(EnvironmentFaultError, match="no port"):
        minimize(one.run(), one.folder)


def test_what_was_asked_before_is_not_executed_again(tmp_path: Path) -> None:
    one = bench(tmp_path)
    failing(one, 41)
    first = minimize(one.run(), one.folder)
    count = len(one.machine.executed)
    assert minimize(one.run(), one.folder) == first
    assert len(one.machine.executed) == count


def test_a_finding_is_needed(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"finding\.json is not there yet"):
        minimize(bench(tmp_path).run(), tmp_path)
