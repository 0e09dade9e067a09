import random
from collections.abc import Callable, Sequence

import pytest

from riot_bus.generalize.minimize import minimize
from riot_bus.vocabulary.errors import InconclusiveError

Kept = tuple[int, ...]


class Recorder:
    """An oracle that counts and refuses a question asked twice."""

    def __init__(self, fails: Callable[[Kept], bool]) -> None:
        self.fails = fails
        self.asked: list[Kept] = []
        self.batches: list[int] = []

    def __call__(self, questions: Sequence[Kept]) -> list[bool]:
        self.batches.append(len(questions))
        for question in questions:
            assert question not in self.asked
            assert list(question) == sorted(question)
            self.asked.append(question)
        return [self.fails(question) for question in questions]


def needs(*items: int) -> Recorder:
    return Recorder(lambda kept: set(items) <= set(kept))


@pytest.mark.parametrize("items", [(0,), (99,), (3, 50), (0, 1, 2), (97, 98, 99), tuple(range(0, 100, 9))])
def test_finds_exactly_the_needed_messages(items: tuple[int, ...]) -> None:
    ask = needs(*items)
    result = minimize(100, ask)
    assert result.kept == items
    assert result.one_minimal
    assert result.needs_messages
    assert result.trials == len(ask.asked)


@pytest.mark.parametrize(("n", "needed", "most"), [(1000, 1, 13), (1000, 3, 38), (5000, 1, 16), (5000, 3, 45)])
def test_trials_without_prior_stay_within_the_bound(n: int, needed: int, most: int) -> None:
    for seed in range(8):
        items = random.Random(seed).sample(range(n), needed)
        result = minimize(n, needs(*items))
        assert result.kept == tuple(sorted(items))
        assert result.trials <= most


def test_weights_save_trials() -> None:
    weights = [50.0 if index % 50 == 7 else 1.0 for index in range(1000)]
    assert minimize(1000, needs(507), weights=weights).trials <= 11
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
    assert not result.needs_messages
    assert result.trials == 2


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
        minimize(3, lambda questions: [True])


def test_progress_is_told() -> None:
    told: list[tuple[int, int | None, str]] = []
    result = minimize(50, needs(7), progress=lambda done, total, doing: told.append((done, total, doing)))
    assert told[-1][0] == result.trials
