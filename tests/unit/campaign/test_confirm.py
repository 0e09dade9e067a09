from __future__ import annotations

from functools import partial
from itertools import pairwise

import pytest

from riot_bus.campaign.confirm import join_logs, more_nominal, repeat, repeat_in_order
from riot_bus.campaign.triage import Failure, group
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation
from tests.unit.campaign.test_campaign import CRASH, Pure

OTHER = Violation("crash", "part", "crash in part: elsewhere", "")


def runner(chance: float, violation: Violation = CRASH) -> Pure:
    def answer(case: TestCase) -> Outcome:
        fails = int(case.digest(), 16) % 1000 < 1000 * chance
        return Outcome(Verdict.FAIL, (violation,)) if fails else Outcome(Verdict.PASS)

    return Pure(answer)


def test_what_always_fails_takes_few_trials() -> None:
    pure = runner(1.0)
    rate = repeat(TestCase(seed=3), CRASH.signature, pure)
    assert (rate.hits, rate.total) == (4, 4)
    assert [case.again for case in pure.executed] == [1, 2, 3, 4]
    assert {case.seed for case in pure.executed} == {3}
    assert len({case.digest() for case in [TestCase(seed=3), *pure.executed]}) == 5


def test_what_never_fails_again_takes_twenty() -> None:
    assert repeat(TestCase(), CRASH.signature, runner(0.0)).total == 20


def test_what_could_not_be_judged_is_no_pass() -> None:
    def answer(case: TestCase) -> Outcome:
        return Outcome(Verdict.UNJUDGED) if case.again % 2 else Outcome(Verdict.FAIL, (CRASH,))

    rate = repeat(TestCase(), CRASH.signature, Pure(answer))
    assert rate.hits == rate.total >= 4


def test_another_failure_is_no_confirmation() -> None:
    assert repeat(TestCase(), CRASH.signature, runner(1.0, OTHER)).hits == 0


@pytest.mark.parametrize("chance", [0.2, 0.5, 0.9])
def test_the_interval_holds_the_rate(chance: float) -> None:
    rates = [repeat(TestCase(seed=seed), CRASH.signature, runner(chance)) for seed in range(300)]
    held = sum(rate.low <= chance <= rate.high for rate in rates)
    missed = sum(rate.hits == 0 for rate in rates)
    assert held >= 0.93 * len(rates)
    assert missed <= 0.03 * len(rates)


TWO = (Message(1, "a", b""), Message(2, "b", b""))


@pytest.mark.parametrize(("fast", "kept", "ordered"), [(1.0, 1.0, False), (0.4, 1.0, True), (0.4, 0.0, False)])
def test_the_order_is_kept_where_a_failure_comes_more_often_so(fast: float, kept: float, *, ordered: bool) -> None:
    def answer(case: TestCase) -> Outcome:
        return runner(kept if case.ordered else fast).answer(case)

    case, rate = repeat_in_order(TestCase(TWO), CRASH.signature, Pure(answer))
    assert case.ordered is ordered
    assert rate.hits > 0


def test_one_topic_has_no_order_to_keep() -> None:
    pure = runner(0.4)
    assert not repeat_in_order(TestCase(TWO[:1]), CRASH.signature, pure)[0].ordered
    assert not any(case.ordered for case in pure.executed)


@pytest.mark.parametrize(
    ("monitor", "hits", "confirmed"),
    [("crash", 0, False), ("crash", 1, True), ("mined", 0, False), ("mined", 1, False), ("mined", 3, True)],
)
def test_a_mined_rule_must_fire_more_often_than_by_chance(monitor: str, hits: int, *, confirmed: bool) -> None:
    violation = Violation(monitor, "part", "it")
    failure = Failure(violation, TestCase(), 0, Outcome(Verdict.FAIL), 0, rate=proportion(hits, 20))
    assert failure.confirmed is confirmed


def test_a_case_with_plain_values_stands_for_a_failure_before_one_with_fewer_changes() -> None:
    failures: dict[str, Failure] = {}
    kinds = {
        "cut off": Injection("a", fault="truncate"),
        "missing": Injection("a", "x", fault="omit"),
        "no number": Injection("a", "x", float("nan")),
        "plain": Injection("a", "x", 1e9),
    }
    failed, types = Outcome(Verdict.FAIL, (CRASH,)), {("a", "x"): "float64"}
    add = partial(group, failures, outcome=failed, types=types)
    for number, injection in enumerate(kinds.values()):
        case = TestCase(injections=(injection,) * (1 + number))
        add(case, trial=number)
        assert failures[CRASH.signature].trial == number
    for kind, trial, kept in (("missing", 9, 3), ("another type", 10, 3), ("plain", 11, 11)):
        add(TestCase(injections=(kinds.get(kind, Injection("a", "x", "1")),)), trial=trial)
        assert failures[CRASH.signature].trial == kept


def test_logs_are_joined_without_going_back_in_time() -> None:
    log, other = (tuple(Message(10**9 + n * 10**7, "cmd", payload) for n in range(3)) for payload in (b"1", b"2"))
    joined = join_logs([log, (), other, log])
    assert [message.payload for message in joined] == [each.payload for each in (*log, *other, *log)]
    assert all(one.time < another.time for one, another in pairwise(joined))
    assert join_logs([]) == ()


@pytest.mark.parametrize(("played", "times"), [(1, 2), (4, 2), (5, 4), (30, 16)])
def test_nominal_messages_are_twice_as_many(played: int, times: int) -> None:
    pure = runner(0.0)
    log = tuple(Message(10**9 + n * 10**7, "cmd", b"1") for n in range(4))
    assert len(more_nominal(TestCase(log, (Injection("cmd", "x", 1),)), played, pure)) == 4
    assert {(len(case.messages), case.injections) for case in pure.executed} == {(4 * times, ())}
    assert len({case.digest() for case in pure.executed}) == 4
