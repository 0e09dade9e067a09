"""Growth with every message, with a unit that is a function of its messages."""

from __future__ import annotations

import json
from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from riot_bus.chain.unit.leaks import find_leak, repeat_log
from riot_bus.inject.apply import inject_log
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation

GROWING_LOG = tuple(Message(10**9 + number * 10**7, "cmd", b'{"x": %d}' % number) for number in range(30))
REGISTRY = TypeRegistry()
ALLOWED = 32.0


class GrowingUnit:
    """Grows by `bad` with each message after a large one, by `usual` with each message, by `once` after a large one."""

    parallelism = 2

    def __init__(self, *, bad: float = 0.0, usual: float = 0.0, once: float = 0.0) -> None:
        self.bad, self.usual, self.once = bad, usual, once
        self.asked: list[TestCase] = []

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        self.asked += cases
        return [self._play(case) for case in cases]

    def _play(self, case: TestCase) -> Outcome:
        messages, _ = inject_log(case.messages, case.injections, registry=REGISTRY, seed=case.seed)
        large, grown = False, 0.0
        for message in messages:
            large = large or json.loads(message.payload)["x"] > 10**6
            grown += self.usual + self.bad * large
        grown += self.once * large
        found = Violation("growth", "part", "growth of part: memory", f"{grown:.0f} MB more")
        return Outcome(Verdict.FAIL, (found,)) if grown > ALLOWED else Outcome(Verdict.PASS)


def growing_case(*injections: Injection) -> TestCase:
    return TestCase(GROWING_LOG, injections, seed=3)


BAD = growing_case(
    Injection("cmd", "x", 5, first=2, last=2),
    Injection("cmd", "x", 1e9, first=20, last=20),
    Injection("cmd", "x", 7, first=4, last=9),
)


def test_growth_with_each_message_is_found_and_the_injection_that_begins_it() -> None:
    unit = GrowingUnit(bad=0.2)
    failure = find_leak(2 / 32, BAD, unit, registry=REGISTRY, types={}).failure
    assert failure is not None
    assert failure.confirmed
    assert failure.violation.signature == "growth of part: memory"
    assert len(failure.case.messages) == 64 * len(GROWING_LOG)
    assert {each.value for each in failure.case.injections} == {1e9}
    assert [each.first for each in failure.case.injections] == [20 + 30 * number for number in range(64)]
    assert failure.details == [f"{failure.violation.detail} (the log 64 times)"]
    assert failure.nominal is not None
    assert (failure.nominal.hits, failure.nominal.total) == (0, 4)


def test_what_grows_once_does_not_leak() -> None:
    unit = GrowingUnit(once=8.0)
    found = find_leak(8 / 32, BAD, unit, registry=REGISTRY, types={})
    assert (found.failure, found.nominal) == (None, None)
    assert len(unit.asked) == 1


def test_a_unit_that_grows_with_nominal_messages_is_no_failure() -> None:
    found = find_leak(8 / 32, BAD, GrowingUnit(usual=0.2, bad=0.2), registry=REGISTRY, types={})
    assert found.failure is None
    assert found.nominal is not None
    assert found.nominal.signature == "growth of part: memory"


def test_a_message_that_comes_more_often_is_no_leak() -> None:
    """A unit that keeps all messages grows more with a burst of them, for which the burst is not to blame."""
    burst = growing_case(Injection("cmd", fault="duplicate", first=20, last=20, copies=20))
    unit = GrowingUnit(usual=0.2)
    found = find_leak(4 / 32, burst, unit, registry=REGISTRY, types={})
    assert found.failure is None
    assert found.nominal is not None
    assert found.nominal.detail == "648 MB more"  # twice the 32 times 50 messages, in whole logs: 108 times 30


def test_the_more_it_grew_the_fewer_repeats() -> None:
    unit = GrowingUnit(bad=1.0)
    failure = find_leak(10 / 32, BAD, unit, registry=REGISTRY, types={}).failure
    assert failure is not None
    assert len(failure.case.messages) == 13 * len(GROWING_LOG)


def test_a_long_log_is_not_repeated() -> None:
    unit = GrowingUnit(bad=1.0)
    long = TestCase(GROWING_LOG * 40, BAD.injections, seed=3)
    assert find_leak(1 / 32, long, unit, registry=REGISTRY, types={}).failure is None
    assert unit.asked == []


bounds = st.integers(0, len(GROWING_LOG) - 1)
chosen = st.one_of(
    st.builds(lambda a, b, x: Injection("cmd", "x", x, first=min(a, b), last=max(a, b)), bounds, bounds, bounds),
    st.builds(lambda x: Injection("cmd", "x", x), bounds),
    st.builds(lambda a: Injection("cmd", fault="drop", first=a, last=a), bounds),
    st.builds(lambda a: Injection("cmd", fault="duplicate", first=a, last=a, copies=2), bounds),
    st.builds(lambda a, x: Injection("cmd", "x", x, start=a / 100, end=(a + 3) / 100), bounds, bounds),
    st.builds(lambda x: Injection("cmd", "x", x, where="x < 7"), bounds),
)


@given(st.lists(chosen, max_size=5), st.integers(1, 4))
def test_a_repeated_log_has_the_same_injections_each_time(injections: list[Injection], times: int) -> None:
    def payloads(case: TestCase) -> list[bytes]:
        return [
            each.payload for each in inject_log(case.messages, case.injections, registry=REGISTRY, seed=case.seed)[0]
        ]

    alone = growing_case(*injections)
    assert payloads(repeat_log(alone, times, registry=REGISTRY)) == payloads(alone) * times
