from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

import pytest

from riot_bus.chain.base.logs import FailingLog
from riot_bus.chain.steps.minimize import minimize
from riot_bus.findings.records import FindingRecord, MinimalRecord, ProportionRecord
from riot_bus.findings.steps import find_step
from riot_bus.generalize.minimize import BUDGET
from riot_bus.statistics.rates import exact_interval
from riot_bus.trial.baseline import Baseline
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import (
    COUNT,
    SYSTEM,
    Bench,
    always,
    bench,
    command,
    hangs,
    said,
    share,
    write_finding,
)


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
    assert record.summary == (f"{COUNT} messages -> 1: command ({record.trials} trials); command:speed: -5.0 -> 0.0")
    assert record.lines() == ["simplified: command:speed: -5.0 -> 0.0"]
    assert said(log.messages[0])["speed"] == 0


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


def nominal_passes(one: Bench) -> None:
    known = FindingRecord.load(one.folder)
    passes = ProportionRecord(value=0.0, low=0.0, high=0.6, count=0, total=4)
    known.model_copy(update={"nominal": passes}).save(one.folder)


def test_what_fails_because_messages_are_missing_is_another_cause(tmp_path: Path) -> None:
    """The unit also fails, at the same place, when the first message is missing, whatever else there is."""

    def fails(messages: Sequence[Message]) -> int | None:
        numbers = [message.sequence for message in messages]
        modified = 41 in numbers and said(messages[numbers.index(41)]) != said(command("step", 3.0, 41))
        return 1 if modified or 0 not in numbers else None

    one = bench(tmp_path, fails=fails)
    failing(one, 41)
    assert minimize(one.run(), one.folder).kept != (0, 41)  # nothing is known of the nominal log
    (one.folder / "minimal.json").unlink(missing_ok=True)
    nominal_passes(one)
    record = minimize(one.run(), one.folder)
    assert record.kept == (0, 41)
    assert record.missing == ("command",)
    assert record.missing_failed[0] > 0
    assert "command alone, unmodified, fails likewise" in record.summary
    other = one.folder.with_name(f"{one.folder.name}-missing")
    assert FindingRecord.load(other).modified == 0
    log = FailingLog.load(other / "failure.mcap", registry=one.workspace.context.registry)
    assert fails(log.messages) == 1
    assert not log.originals


def test_a_modified_message_that_does_what_its_absence_does_is_told_apart(tmp_path: Path) -> None:
    """Message 5 is refused when it is modified; without it, refused or not there, message 41 is fatal."""

    def fails(messages: Sequence[Message]) -> int | None:
        given = {message.sequence: message for message in messages}
        set_up = 5 in given and said(given[5]) == said(command("step", 3.0, 5))
        return 1 if 41 in given and not set_up else None

    one = bench(tmp_path, fails=fails)
    failing(one, 5)
    nominal_passes(one)
    record = minimize(one.run(), one.folder)
    assert record.kept == (5, 41)
    assert record.without[0][0] == record.without[0][1] > 0
    assert record.missing == ("command",)
    assert "command alone, unmodified, fails likewise" in record.summary
    assert FindingRecord.load(one.folder.with_name(f"{one.folder.name}-missing")).modified == 0


def test_start_up_messages_stay_when_they_are_needed(tmp_path: Path) -> None:
    def fails(messages: Sequence[Message]) -> int | None:
        return hangs(messages) if messages and messages[0].sequence == 0 else None

    one = bench(tmp_path, fails=fails)
    failing(one, 41)
    nominal_passes(one)
    record = minimize(one.run(), one.folder)
    assert record.kept == (0, 41)
    assert record.absent is None


def test_what_fails_by_the_order_of_messages_keeps_it(tmp_path: Path) -> None:
    """A late message comes after the one that it should come before."""

    def fails(messages: Sequence[Message]) -> int | None:
        numbers = [message.sequence for message in messages]
        wrong = {20, 21} <= set(numbers) and numbers.index(21) < numbers.index(20)
        return numbers.index(20) if wrong else None

    one = bench(tmp_path, fails=fails)
    messages = [command("step", 3.0, number) for number in range(COUNT)]
    messages[20:22] = [messages[21], messages[20].with_(time=messages[21].time + 1)]
    write_finding(one, messages, {20: command("step", 3.0, 20)})
    nominal_passes(one)
    record = minimize(one.run(), one.folder)
    assert record.kept == (20, 21)
    assert record.one_minimal
    log = FailingLog.load(one.folder / "minimal.mcap", registry=one.workspace.context.registry)
    assert [message.sequence for message in log.messages] == [21, 20]
    assert list(log.originals) == [20]


def test_times_decide_only_where_the_unit_is_not_fed_as_fast_as_it_takes_messages(tmp_path: Path) -> None:
    def fails(messages: Sequence[Message]) -> int | None:
        numbers = [message.sequence for message in messages]
        if not {3, 41} <= set(numbers):
            return None
        apart = messages[numbers.index(41)].time - messages[numbers.index(3)].time
        return 1 if apart >= 0.6e9 or not paced else None

    paced = True
    one = bench(tmp_path, SYSTEM + "rate = 1\n", fails=fails)
    failing(one, 3, 41)
    record = minimize(one.run(), one.folder)
    log = FailingLog.load(one.folder / "minimal.mcap", registry=one.workspace.context.registry)
    assert log.messages[1].time - log.messages[0].time == 1_000_000_000
    assert "1 shorter gap" in record.summary
    told = "simplified: command[0] to command[1]: 1.9 s -> 1 s; shorter times that were tried pass"
    assert told in record.lines()
    paced = False
    two = bench(tmp_path / "fast", fails=fails) if (tmp_path / "fast").mkdir() is None else one
    failing(two, 3, 41)
    record = minimize(two.run(), two.folder)
    log = FailingLog.load(two.folder / "minimal.mcap", registry=two.workspace.context.registry)
    assert log.messages[1].time - log.messages[0].time == 1_000_000
    assert not any(one.what == "gap" for one in record.simplified)


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


def test_one_wrong_answer_is_noticed_and_asked_again(tmp_path: Path) -> None:
    one = bench(tmp_path, wrong=lambda case: not case.again and [each.sequence for each in case.messages] == [41])
    failing(one, 41)
    record = minimize(one.run(), one.folder)
    assert record.kept == (41,)
    assert record.one_minimal
    assert record.confidence == 0.95
    assert record.failed[0] > 0
    assert record.without[0][0] == 0


@pytest.mark.parametrize("rate", [0.3, 0.9])
def test_a_failure_that_comes_sometimes_gives_the_same_log(tmp_path: Path, rate: float) -> None:
    one = bench(tmp_path, wrong=lambda case: hangs(case.messages) is not None and share(case) > rate)
    failing(one, 41)
    known = FindingRecord.load(one.folder)
    hits = round(10 * rate)
    seen = ProportionRecord(value=rate, low=0.0, high=1.0, count=hits, total=10)
    known.model_copy(update={"rate": seen}).save(one.folder)
    record = minimize(one.run(), one.folder)
    assert (record.kept, record.one_minimal) == ((41,), True)
    assert record.without[0][1] >= (3 if rate == 0.3 else 1)
    minimal = FailingLog.load(one.folder / "minimal.mcap", registry=one.workspace.context.registry)
    last = [case for case in one.machine.executed if case.messages == minimal.messages][-record.failed[1] :]
    assert 12 <= record.failed[1] <= 120
    assert [share(case) <= rate for case in last].count(True) == record.failed[0]  # by fresh trials, all in a row


@pytest.mark.parametrize("seed", [0, 1, 7, 12, 45, 48])
def test_of_messages_that_crash_sometimes_one_is_kept_with_its_own_rate(tmp_path: Path, seed: int) -> None:
    """The case of the campaign nearly always fails, as it has ten chances; each of them is one of 0.3."""
    chance = random.Random(seed)

    def fails(messages: Sequence[Message]) -> int | None:
        bad = [n for n, each in enumerate(messages) if hangs([each]) is not None and chance.random() < 0.3]
        return bad[0] if bad else None

    one = bench(tmp_path, fails=fails)
    failing(one, *range(3, 53, 5))
    always_seen = ProportionRecord(value=1.0, low=0.4, high=1.0, count=4, total=4)
    FindingRecord.load(one.folder).model_copy(update={"rate": always_seen}).save(one.folder)
    record = minimize(one.run(), one.folder)
    assert len(record.kept) == 1
    assert record.one_minimal
    low, high = exact_interval(*record.failed, confidence=0.99)
    assert low <= 0.3 <= high


def test_what_fresh_trials_contradict_is_not_told(tmp_path: Path) -> None:
    """The drive hangs whenever it should as long as messages are searched for, and never again."""
    seen = ProportionRecord(value=0.3, low=0.0, high=1.0, count=3, total=10)

    def minimized(name: str, most: int, budget: int = BUDGET) -> tuple[int, MinimalRecord]:
        (tmp_path / name).mkdir()
        one = bench(tmp_path / name)
        one.machine.wrong = lambda case: hangs(case.messages) is not None and len(one.machine.executed) >= most
        failing(one, 41)
        FindingRecord.load(one.folder).model_copy(update={"rate": seen}).save(one.folder)
        record = minimize(one.run(), one.folder, budget=budget)
        return len(one.machine.executed) - record.failed[1], record

    searched, _ = minimized("reliable", 10_000)
    with pytest.raises(InconclusiveError, match=r"none of \d+ fresh trials of what was kept, 1 message, failed"):
        minimized("once", searched)
    _, record = minimized("few", searched, budget=searched + 5)  # too few to say that it does not fail
    assert (record.kept, record.one_minimal, record.confidence) == ((41,), False, 0.0)


def needs_two(messages: Sequence[Message]) -> int | None:
    """Fail at the end when two messages have come, the first of which is nothing special."""
    return len(messages) - 1 if {20, 41} <= {each.sequence for each in messages} else None


def test_a_budget_that_ends_leaves_the_best_so_far(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=needs_two)
    failing(one, 41)
    sizes = []
    for budget in (2, 13, 15, 40):
        record = minimize(one.run(), one.folder, budget=budget)
        assert {20, 41} <= set(record.kept)
        log = FailingLog.load(one.folder / "minimal.mcap", registry=one.workspace.context.registry)
        assert len(log.messages) == len(record.kept)
        assert record.one_minimal is (budget == 40)
        assert record.one_minimal is ("not proven to be minimal" not in record.summary)
        sizes.append(len(record.kept))
    assert sizes[0] == COUNT
    assert sizes[-1] == 2
    assert sizes == sorted(sizes, reverse=True)
    assert len(set(sizes)) > 2


def test_an_interruption_keeps_the_best_so_far_and_the_next_command_goes_on(tmp_path: Path) -> None:
    def fails(messages: Sequence[Message]) -> int | None:
        if len(one.machine.executed) == 17:
            one.machine.fails = needs_two
            raise KeyboardInterrupt
        return needs_two(messages)

    one = bench(tmp_path, fails=fails)
    failing(one, 41)
    with pytest.raises(KeyboardInterrupt):
        minimize(one.run(), one.folder)
    half = MinimalRecord.load(one.folder)
    assert half.interrupted
    assert not half.one_minimal
    assert 2 < len(half.kept) < COUNT
    assert half.trials > 0
    assert not MinimalRecord.exists(one.folder)
    count = len(one.machine.executed)
    record = one.workspace.carry_out(find_step("minimize"), one.folder)
    assert isinstance(record, MinimalRecord)
    assert (record.kept, record.one_minimal, record.interrupted) == ((20, 41), True, False)
    assert len(one.machine.executed) - count < record.trials
    assert MinimalRecord.exists(one.folder)


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
    with pytest.raises(ConfigError, match=r"finding\.json does not exist yet"):
        minimize(bench(tmp_path).run(), tmp_path)


def overloaded(messages: Sequence[Message]) -> int | None:
    """The unit adds up the latest values of two topics."""
    load = {"left": 0.0, "right": 0.0}
    for place, message in enumerate(messages):
        load[message.key] = said(message)["speed"]
        if sum(load.values()) > 100:
            return place
    return None


def loads(*speeds: float, key: str = "left") -> list[Message]:
    return [command("step", speed, number).with_(key=key) for number, speed in enumerate(speeds)]


def probed() -> Baseline:
    return Baseline(trials=3, probe=tuple(loads(20.0, 25.0, key="right")), probe_answers={"sum": 2})


def test_what_of_the_probe_the_failure_needs_becomes_a_part_of_the_log(tmp_path: Path) -> None:
    """80 alone are no overload: a rule over the one message would state a limit that no other log has."""
    one = bench(tmp_path, fails=overloaded, alone=probed())
    write_finding(one, loads(*[30.0] * 9, 80.0), {9: loads(30.0)[0].with_(sequence=9)})
    nominal_passes(one)
    record = minimize(one.run(), one.folder)
    assert (record.topics, record.unprobed, record.added, record.before) == (("left", "right"), True, 2, 12)
    assert record.lines()[-1] == "nominal, after the end of the log: the last 1 of these messages"
    log = FailingLog.load(one.folder / "minimal.mcap", registry=one.workspace.context.registry)
    assert overloaded(log.messages) == 1
    assert list(log.originals) == [log.messages[0].sequence] == [9]
    assert log.messages[0].time < log.messages[1].time
    assert all(case.unprobed for case in one.machine.executed)


def test_a_log_that_fails_by_itself_gets_no_probe(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=overloaded, alone=probed())
    write_finding(one, loads(*[30.0] * 9, 180.0), {9: loads(30.0)[0].with_(sequence=9)})
    record = minimize(one.run(), one.folder)
    assert (record.topics, record.unprobed, record.added, record.kept) == (("left",), True, 0, (9,))
    assert (
        said(FailingLog.load(one.folder / "minimal.mcap", registry=one.workspace.context.registry).messages[0])["speed"]
        > 100
    )  # the probe would make 76 and more fail


def test_what_only_a_probe_shows_keeps_it(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=overloaded, alone=probed())
    write_finding(one, loads(*[30.0] * 9, 80.0), {9: loads(30.0)[0].with_(sequence=9)})
    FindingRecord.load(one.folder).model_copy(update={"monitor": "silent"}).save(one.folder)
    record = minimize(one.run(), one.folder)
    assert (record.topics, record.unprobed, record.added) == (("left",), False, 0)
    assert not any(case.unprobed for case in one.machine.executed)
