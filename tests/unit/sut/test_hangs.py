from __future__ import annotations

from riot_bus.sut.hangs import Hangs, hang_stacks
from riot_bus.sut.python_report import ThreadStack

SPIN = frozenset({("spin", "main")})
NOWHERE = frozenset[tuple[str, ...]]()


def known(*, trials: float = 0.0, longest: float = 0.0) -> Hangs:
    hangs = Hangs()
    hangs.add(SPIN, waited=10.0)
    hangs.add(NOWHERE, waited=10.0)
    hangs.ended(trials, busy=longest)
    return hangs


def test_only_what_was_waited_for_is_known() -> None:
    assert not Hangs()
    assert not Hangs().is_known(SPIN, busy=9.0, timeout=10.0)
    assert known()
    assert known().is_known(SPIN, busy=1.0, timeout=10.0)
    assert not known().is_known(SPIN, busy=0.5, timeout=10.0)
    assert not known().is_known(frozenset({("spin", "other", "main")}), busy=9.0, timeout=10.0)


def test_without_stacks_there_is_more_patience() -> None:
    assert not known().is_known(NOWHERE, busy=2.9, timeout=10.0)
    assert known().is_known(NOWHERE, busy=3.0, timeout=10.0)


def test_a_unit_that_was_slow_and_went_on_gets_three_times_as_long() -> None:
    assert not known(longest=0.8).is_known(SPIN, busy=2.3, timeout=10.0)
    assert known(longest=0.8).is_known(SPIN, busy=2.5, timeout=10.0)


def test_known_hangs_are_waited_for_within_a_tenth_of_the_time_and_forgotten_if_they_end() -> None:
    assert not known(trials=299.0).may_wait(10.0)  # two took 10 s each, and a third one is to
    hangs = known(trials=300.0)
    assert hangs.may_wait(10.0)
    hangs.add(SPIN, waited=10.0)
    assert not hangs.may_wait(10.0)
    hangs.ended(200.0, busy=2.0, taken_for=SPIN)
    assert hangs.may_wait(10.0)
    assert not hangs.is_known(SPIN, busy=9.0, timeout=10.0)


def test_a_place_has_the_stacks_of_threads_that_stand_elsewhere_than_at_rest() -> None:
    stacks = [ThreadStack(("spin", "main"), ""), ThreadStack(("get", "worker"), "")]
    assert hang_stacks(stacks, ("spin",)) == SPIN
    assert hang_stacks(stacks, ()) == NOWHERE
