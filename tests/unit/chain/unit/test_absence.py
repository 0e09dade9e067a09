from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from riot_bus.chain.base.logs import FailingLog
from riot_bus.findings.records import FindingRecord, MinimalRecord, ProportionRecord
from riot_bus.findings.steps import find_step
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import bench, command, commands, panel, share, write_finding
from tests.unit.chain.steps.test_minimize import nominal_passes


def without(*left_out: int) -> list[Message]:
    return [message for message in commands(panel(0)) if message.sequence not in left_out]


@pytest.mark.parametrize("modified", [False, True])
def test_of_what_fails_since_a_message_is_missing_it_is_told_which(tmp_path: Path, *, modified: bool) -> None:
    def fails(messages: Sequence[Message]) -> int | None:
        """Fail at the eleventh message or a later one, unless the fifth has come."""
        numbers = [message.sequence for message in messages]
        late = [place for place, number in enumerate(numbers) if number >= 10]
        return late[0] if late and 4 not in numbers else None

    one = bench(tmp_path, fails=fails)
    one.workspace.nominal_log()
    messages, originals = without(4), {}
    if modified:
        originals = {20: messages[19]}
        messages[19] = messages[19].with_(payload=command("step", 99.0).payload)
    write_finding(one, messages, originals)
    nominal_passes(one)
    record = one.workspace.carry_out(find_step("minimize"), one.folder)
    assert isinstance(record, MinimalRecord)
    assert len(record.kept) == 1
    assert record.absent is not None
    assert (record.absent.numbers, record.absent.topics) == ((4,), ("command",))
    passed, total = record.absent.passed
    assert passed == total > 0
    assert "fails since command (number 4 of the nominal log) is missing: with it, " in record.summary
    assert any("is missing" in line for line in record.lines())
    log = FailingLog.load(one.folder / "minimal.mcap", registry=one.workspace.context.registry)
    assert not log.originals
    assert MinimalRecord.load(one.folder) == record


def test_what_nothing_heals_misses_nothing(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=lambda messages: 0 if messages else None)
    one.workspace.nominal_log()
    write_finding(one, without(4), {})
    nominal_passes(one)
    record = one.workspace.carry_out(find_step("minimize"), one.folder)
    assert isinstance(record, MinimalRecord)
    assert record.absent is None


@pytest.mark.parametrize("rate", [0.6, 0.3])
def test_a_message_whose_absence_fails_sometimes_is_found(tmp_path: Path, rate: float) -> None:
    def fails(messages: Sequence[Message]) -> int | None:
        numbers = [message.sequence for message in messages]
        return numbers.index(50) if 50 in numbers and 0 not in numbers else None

    one = bench(tmp_path, fails=fails, wrong=lambda case: fails(case.messages) is not None and share(case) > rate)
    one.workspace.nominal_log()
    write_finding(one, without(0), {})
    nominal_passes(one)
    seen = ProportionRecord(value=rate, low=0.0, high=1.0, count=round(10 * rate), total=10)
    FindingRecord.load(one.folder).model_copy(update={"rate": seen}).save(one.folder)
    record = one.workspace.carry_out(find_step("minimize"), one.folder)
    assert isinstance(record, MinimalRecord)
    assert record.kept == (49,)
    assert record.absent is not None
    assert record.absent.numbers == (0,)
