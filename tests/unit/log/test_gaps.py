from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.log import gaps as module
from riot_bus.log.gaps import Gaps


def total(numbers: list[int]) -> int:
    gaps = Gaps()
    return sum(gaps.see("a", number) for number in numbers)


def test_what_is_left_out_is_missing_and_no_more_when_it_comes_late() -> None:
    assert total([5, 6, 7]) == 0
    assert total([5, 8]) == 2
    assert total([5, 8, 6]) == 1
    assert total([5, 8, 6, 7]) == 0
    assert total([5, 8, 6, 6, 8, 5]) == 1


def test_publishers_are_apart() -> None:
    gaps = Gaps()
    assert [gaps.see(*each) for each in (("a", 1), ("b", 7), ("a", 2), ("b", 9))] == [0, 0, 0, 1]


def test_who_begins_anew_misses_nothing() -> None:
    assert total([500, 1, 2, 3]) == 0
    assert total([5000, 100, 101, 103]) == 1
    assert total([2**32 - 1, 0, 1]) == 0


def test_a_huge_gap_takes_no_memory() -> None:
    gaps = Gaps()
    gaps.see("a", 1)
    assert gaps.see("a", 10**15) == 10**15 - 2
    assert gaps.see("a", 10**15 - 1) == -1
    assert gaps.see("a", 10**15 - 5000) == 0


def test_too_many_publishers_are_said(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr(module, "_MOST_PUBLISHERS", 2)
    gaps = Gaps()
    for name in "abc":
        gaps.see(name, 1)
    assert gaps.untold
    assert gaps.see("c", 9) == 0
    assert gaps.see("a", 3) == 1


@settings(deadline=None)
@given(st.sets(st.integers(2, 300)), st.randoms(use_true_random=False))
def test_in_any_order_only_what_never_came_is_missing(numbers: set[int], random) -> None:  # type: ignore[no-untyped-def]
    last = max(numbers, default=2) + 1
    rest = list(numbers)
    random.shuffle(rest)
    assert total([1, last, *rest]) == last - 2 - len(numbers)
