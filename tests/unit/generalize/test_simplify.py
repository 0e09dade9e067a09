import random
from collections.abc import Callable, Sequence

import pytest

from riot_bus.generalize.simplify import Levels, simplify
from riot_bus.statistics.noise import Noise

CONFIRMED = Noise.after(4, 4, nominal_total=4)


class Recorder:
    """A reliable oracle that counts."""

    def __init__(self, fails: Callable[[Levels], bool]) -> None:
        self.fails = fails
        self.asked: list[Levels] = []

    def __call__(self, questions: Sequence[Levels]) -> list[bool]:
        self.asked += questions
        return [self.fails(question) for question in questions]


def test_what_does_not_matter_takes_its_simplest_value() -> None:
    ask = Recorder(lambda levels: True)
    found = simplify([2, 5, 9], ask, noise=CONFIRMED)
    assert found.levels == (0, 0, 0)
    assert found.trials == len(ask.asked) <= 4


@pytest.mark.parametrize("lowest", range(1, 12))
def test_a_ladder_alone_goes_to_the_lowest_rung_that_fails(lowest: int) -> None:
    ask = Recorder(lambda levels: levels[0] >= lowest)
    found = simplify([12], ask, noise=CONFIRMED)
    assert found.levels == (min(lowest, 11),)
    assert found.trials == len(ask.asked) <= 9


def test_ladders_that_are_needed_together_are_kept_together() -> None:
    ask = Recorder(lambda levels: levels[1] >= 3 and levels[3] >= 1)
    assert simplify([4, 6, 2, 7, 9], ask, noise=CONFIRMED).levels == (0, 3, 0, 1, 0)


def test_rungs_that_are_not_monotone_still_fail() -> None:
    def fails(levels: Levels) -> bool:
        return levels[0] in (2, 5, 9)

    found = simplify([10], Recorder(fails), noise=CONFIRMED)
    assert fails(found.levels)


@pytest.mark.parametrize("budget", [0, 1, 2, 4, 9])
def test_a_budget_that_ends_leaves_what_fails(budget: int) -> None:
    told: list[Levels] = []
    ask = Recorder(lambda levels: levels[0] >= 5 and levels[1] >= 2)
    found = simplify([20, 6, 4], ask, noise=CONFIRMED, budget=budget, better=told.append)
    assert found.trials == len(ask.asked) <= budget
    assert ask.fails(found.levels)
    assert found.levels == (told[-1] if told else (19, 5, 3))


def test_what_does_not_fail_any_more_stays_as_it_is() -> None:
    assert simplify([3, 3], Recorder(lambda levels: False), noise=CONFIRMED).levels == (2, 2)


@pytest.mark.parametrize("rate", [0.9, 0.5])
def test_what_fails_sometimes_comes_to_the_same(rate: float) -> None:
    right = 0
    for seed in range(10):
        chance = random.Random(seed)

        def ask(questions: Sequence[Levels], chance: random.Random = chance) -> list[bool]:
            return [levels[1] >= 3 and levels[2] >= 1 and chance.random() < rate for levels in questions]

        noise = Noise.after(round(10 * rate), 10, nominal_total=4)
        right += simplify([2, 8, 2, 5], ask, noise=noise).levels == (0, 3, 1, 0)
    assert right >= 9
