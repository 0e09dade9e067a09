"""Shrinking what came before a failure, with a unit that is a function of its messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from riot_bus.campaign.history import AfterOthers
from riot_bus.chain.histories import shrink_history
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation

LOG = tuple(Message(10**9 + number, "cmd", b'{"x": %d}' % number) for number in range(3))
PROBE = LOG[-1:]
WORN = Violation("crash", "part", "crash in part: worn", "ValueError: worn")


class Unit:
    """Fails on a 9 when it has had two 7s before."""

    parallelism = 2

    def __init__(self) -> None:
        self.asked: list[TestCase] = []

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        self.asked += cases
        return [self._play(case) for case in cases]

    def _play(self, case: TestCase) -> Outcome:
        sevens = 0
        for message in case.messages:
            sevens += message.payload == b'{"x": 7}'
            if message.payload == b'{"x": 9}' and sevens >= 2:
                return Outcome(Verdict.FAIL, (WORN,))
        return Outcome(Verdict.PASS)


def case(value: int) -> TestCase:
    return TestCase(LOG, (Injection("cmd", "x", value, first=1, last=1),))


def test_earlier_cases_that_are_not_needed_are_left_out() -> None:
    unit, values = Unit(), (1, 7, 2, 3, 7, 4, 5)
    found = AfterOthers(WORN, case(9), tuple(map(case, values)), occurrences=2)
    failure = shrink_history(found, unit, registry=TypeRegistry(), probe=PROBE)
    assert failure is not None
    payloads = [message.payload for message in failure.case.messages]
    assert payloads.count(b'{"x": 7}') == 2
    assert len(payloads) == 3 * len(LOG) + 2 * len(PROBE)
    assert failure.confirmed
    assert failure.occurrences == 2
    assert "after 2 earlier test cases" in failure.details[0]
    assert not failure.case.injections
    times = [message.time for message in failure.case.messages]
    assert times == sorted(times)


def test_what_a_fresh_process_does_not_show_is_no_failure() -> None:
    unit = Unit()
    found = AfterOthers(WORN, case(9), (case(7), case(1)))
    assert shrink_history(found, unit, registry=TypeRegistry(), probe=PROBE) is None
    assert len(unit.asked) == 8  # all of it, each time afresh
    assert len({case.digest() for case in unit.asked}) == 8


def test_what_comes_only_sometimes_is_found_too() -> None:
    class Flaky(Unit):
        def _play(self, case: TestCase) -> Outcome:
            return super()._play(case) if int(case.digest(), 16) % 10 < 4 else Outcome(Verdict.PASS)

    found = 0
    for seed in range(20):
        last = replace(case(9), seed=seed)
        failure = shrink_history(
            AfterOthers(WORN, last, (case(7), case(7))), Flaky(), registry=TypeRegistry(), probe=PROBE
        )
        found += failure is not None
    assert found >= 17
