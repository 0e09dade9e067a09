from __future__ import annotations

from riot_bus.processes.python_report import ThreadStack
from riot_bus.trial.hangs import Hangs, KnownHangs, hang_stacks

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


def test_what_one_process_knows_another_one_is_told() -> None:
    other = Hangs()
    other.ended(5.0, busy=0.1)
    other.know(known(longest=0.8).tell())
    assert other.is_known(SPIN, busy=2.5, timeout=10.0)
    assert not other.is_known(SPIN, busy=2.3, timeout=10.0), "another one was so slow, and went on"
    assert other.tell() == KnownHangs(((), (("spin", "main"),)), 0.8)
    other.know(KnownHangs((), 0.5))
    assert not other
    assert other.tell() == KnownHangs((), 0.8)


def test_what_several_processes_find_out_is_put_together() -> None:
    one, two, three = (((name,),) for name in ("one", "two", "three"))
    told = KnownHangs((one, two), 1.0)
    added = told.changed(told, KnownHangs((one, two, three), 0.5))
    assert added == KnownHangs((one, three, two), 1.0)
    assert added.changed(told, KnownHangs((two,), 3.0)) == KnownHangs((three, two), 3.0), (
        "one ended, three is news to it"
    )


def test_a_place_has_the_stacks_of_threads_that_stand_elsewhere_than_at_rest() -> None:
    stacks = [ThreadStack(("spin", "main"), ""), ThreadStack(("get", "worker"), "")]
    assert hang_stacks(stacks, ("spin",)) == SPIN
    assert hang_stacks(stacks, ()) == NOWHERE
