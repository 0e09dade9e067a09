import contextlib
import random
import statistics
from collections.abc import Callable, Sequence

import pytest

from riot_bus.generalize.minimize import Minimal, minimize
from riot_bus.statistics.noise import Noise
from riot_bus.vocabulary.errors import InconclusiveError

Kept = tuple[int, ...]


class Recorder:
    """A reliable oracle that counts."""

    def __init__(self, fails: Callable[[Kept], bool]) -> None:
        self.fails = fails
        self.asked: list[Kept] = []
        self.batches: list[int] = []

    def __call__(self, questions: Sequence[Kept]) -> list[bool]:
        self.batches.append(len(questions))
        for question in questions:
            assert list(question) == sorted(question)
            self.asked.append(question)
        return [self.fails(question) for question in questions]


CONFIRMED = Noise.after(4, 4, nominal_total=4)


def needs(*items: int) -> Recorder:
    return Recorder(lambda kept: set(items) <= set(kept))


@pytest.mark.parametrize("items", [(0,), (99,), (3, 50), (0, 1, 2), (97, 98, 99), tuple(range(0, 100, 9))])
def test_finds_exactly_the_needed_messages(items: tuple[int, ...]) -> None:
    ask = needs(*items)
    result = minimize(100, ask)
    assert result.kept == items
    assert result.one_minimal
    assert result.trials == len(ask.asked)


@pytest.mark.parametrize(("n", "needed", "most"), [(1000, 1, 16), (1000, 3, 46), (5000, 1, 18), (5000, 3, 52)])
def test_trials_without_prior_stay_within_the_bound(n: int, needed: int, most: int) -> None:
    for seed in range(8):
        items = random.Random(seed).sample(range(n), needed)
        result = minimize(n, needs(*items), noise=CONFIRMED)
        assert result.kept == tuple(sorted(items))
        assert result.trials <= most


def test_weights_save_trials() -> None:
    weights = [50.0 if index % 50 == 7 else 1.0 for index in range(1000)]
    assert minimize(1000, needs(507), weights=weights, noise=CONFIRMED).trials <= 12
    assert minimize(1000, needs(508), weights=weights).kept == (508,)


def test_zero_weights_do_not_hide_a_message() -> None:
    assert minimize(10, needs(4), weights=[0.0] * 10).kept == (4,)


def test_a_group_is_searched_first_once_one_of_it_is_needed() -> None:
    groups = ["a" if index % 25 == 0 else "b" for index in range(1000)]
    with_groups = minimize(1000, needs(100, 500, 900), groups=groups)
    assert with_groups.kept == (100, 500, 900)
    assert with_groups.trials < minimize(1000, needs(100, 500, 900)).trials


def test_parallel_questions_come_in_fewer_batches() -> None:
    ask = needs(17, 800)
    assert minimize(1000, ask, parallelism=8).kept == (17, 800)
    assert len(ask.batches) <= 12
    assert max(ask.batches) <= 8


def test_a_log_that_does_not_fail_is_inconclusive() -> None:
    with pytest.raises(InconclusiveError, match="does not fail"):
        minimize(10, Recorder(lambda kept: False))
    with pytest.raises(InconclusiveError):
        minimize(0, Recorder(lambda kept: False))


def test_a_failure_without_messages_is_told() -> None:
    result = minimize(10, Recorder(lambda kept: True))
    assert result.kept == ()
    assert result.trials <= 5


def test_a_system_that_is_not_monotone_still_gives_a_one_minimal_log() -> None:
    # 5 starts the fault, 3 hides it unless 8 comes too.
    ask = Recorder(lambda kept: 5 in kept and (3 not in kept or 8 in kept))
    result = minimize(20, ask)
    assert result.kept == (5,)


def test_wrong_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="one entry"):
        minimize(3, needs(1), weights=[1.0])
    with pytest.raises(ValueError, match="negative"):
        minimize(2, needs(1), weights=[1.0, -1.0])
    with pytest.raises(InconclusiveError, match="outcomes"):
        minimize(3, lambda questions: [])


def test_progress_is_told() -> None:
    told: list[tuple[int, int | None, str]] = []
    result = minimize(50, needs(7), progress=lambda done, total, doing: told.append((done, total, doing)))
    assert told[-1][0] == result.trials


class Noisy:
    """An oracle that fails with probability `p` where the input triggers the failure, else with `eps`."""

    def __init__(self, fails: Callable[[Kept], bool], p: float, eps: float, seed: int) -> None:
        self.fails, self.p, self.eps, self.chance = fails, p, eps, random.Random(seed)

    def __call__(self, questions: Sequence[Kept]) -> list[bool]:
        return [self.chance.random() < (self.p if self.fails(question) else self.eps) for question in questions]


@pytest.mark.parametrize(("p", "eps", "most"), [(0.9, 0.0, 60), (0.7, 0.01, 120), (0.3, 0.01, 450)])
def test_unreliable_failures_take_more_trials_and_come_out_right(p: float, eps: float, most: int) -> None:
    found = []
    for seed in range(12):
        items = tuple(sorted(random.Random(seed).sample(range(300), 2)))
        ask = Noisy(lambda kept, items=items: set(items) <= set(kept), p, eps, seed)
        result = minimize(300, ask, noise=Noise.after(round(10 * p), 10, nominal_total=4))
        found.append((result.kept == items, result.trials))
        assert result.confidence >= 0.95 or not result.one_minimal
    assert sum(right for right, _ in found) >= 10
    assert statistics.median(trials for _, trials in found) <= most


@pytest.mark.parametrize("seed", range(20))
def test_suppressor_pairs_give_a_one_minimal_log(seed: int) -> None:
    chance = random.Random(seed)
    needed = chance.sample(range(60), 2)
    pairs = [chance.sample([item for item in range(60) if item not in needed], 2) for _ in range(3)]

    def fails(kept: Sequence[int]) -> bool:
        return set(needed) <= set(kept) and not any(one in kept and other not in kept for one, other in pairs)

    kept = minimize(60, Recorder(fails), noise=CONFIRMED).kept
    assert fails(kept)
    assert not any(fails([item for item in kept if item != left]) for left in kept)


def test_what_was_shown_is_told_with_the_trials_behind_it() -> None:
    result = minimize(100, needs(3, 50), noise=CONFIRMED)
    assert result.one_minimal
    assert result.confidence == 0.95
    failed, total = result.failed
    assert failed == total > 0
    assert all(without[0] == 0 and without[1] > 0 for without in result.without)
    assert len(result.without) == 2


@pytest.mark.parametrize("budget", [0, 1, 5, 12, 20])
def test_a_budget_that_ends_leaves_the_best_so_far_and_claims_nothing(budget: int) -> None:
    ask, told = needs(17, 400), []
    result = minimize(1000, ask, noise=CONFIRMED, budget=budget, better=told.append)
    assert result.trials == len(ask.asked) <= budget
    assert {17, 400} <= set(result.kept)
    assert not result.one_minimal
    assert result.confidence == 0
    assert result.kept == (told[-1].kept if told else tuple(range(1000)))


def test_smaller_parts_are_told_as_they_are_found() -> None:
    told: list[Minimal] = []
    result = minimize(1000, needs(17, 400), noise=CONFIRMED, better=told.append)
    sizes = [len(part.kept) for part in told]
    assert sizes == sorted(sizes, reverse=True)
    assert told[-1].kept == result.kept
    assert not any(part.one_minimal for part in told)


def test_parts_without_any_cause_are_not_asked() -> None:
    # It fails by 7, and by missing 0, which is another cause.
    ask = Recorder(lambda kept: 7 in kept or 0 not in kept)
    result = minimize(50, ask, causes={7, 30}, noise=CONFIRMED)
    assert 7 in result.kept or 30 in result.kept
    assert all({7, 30} & set(question) for question in ask.asked)
    assert result.one_minimal


def test_what_is_probably_minimal_is_checked_first() -> None:
    ask = needs(0, 1, 2)
    assert minimize(3, ask, likely=True, noise=CONFIRMED).kept == (0, 1, 2)
    assert len(ask.asked) <= 9
    assert minimize(4, needs(0, 2), likely=True, noise=CONFIRMED).kept == (0, 2)
    with pytest.raises(InconclusiveError):
        minimize(3, Recorder(lambda kept: False), likely=True)


@pytest.mark.parametrize("seed", [1, 6, 17, 24])
def test_a_whole_log_that_hardly_fails_any_more_is_inconclusive_or_minimal(seed: int) -> None:
    """It is found to be harmless once rates are known, and there is nothing to add to it."""
    chance = random.Random(seed)

    def ask(questions: Sequence[tuple[int, ...]]) -> list[bool]:
        return [len(question) == 2 and chance.random() < 0.15 for question in questions]

    with contextlib.suppress(InconclusiveError):
        found = minimize(2, ask, likely=True, noise=Noise.after(12, 20, nominal_total=4))
        assert found.kept == (0, 1)
