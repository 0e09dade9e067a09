from __future__ import annotations

import random
from itertools import pairwise

import pytest

from riot_bus.statistics.noise import FlipSearch, Noise


def searched(
    flip: int, n: int, p: float, eps: float, *, seed: int = 0, rises: bool = True, noise: Noise | None = None
) -> FlipSearch:
    """Return a search after it has decided; inputs from `flip` on are as the end is."""
    chance = random.Random(seed)
    search = FlipSearch([1.0] * (n + 2), noise or Noise.after(4, 4), rises=rises)
    while search.confidence < 0.95:
        (position,) = search.questions()
        triggers = (position >= flip) == rises
        search.tell(position, failed=chance.random() < (p if triggers else eps))
        assert search.trials < 2000
    return search


@pytest.mark.parametrize("rises", [True, False])
@pytest.mark.parametrize("flip", [0, 1, 37, 64, 127, 128])
def test_a_reliable_flip_takes_the_trials_of_a_bisection(flip: int, rises: bool) -> None:
    search = searched(flip, 127, 1.0, 0.0, rises=rises)
    assert search.found == flip
    assert search.trials <= 11  # log2(129) is 7; a side that was seen once, at the first trials, is looked at again


@pytest.mark.parametrize(("p", "eps"), [(0.9, 0.0), (0.7, 0.0), (0.7, 0.01), (0.3, 0.01)])
def test_it_is_wrong_at_most_as_often_as_it_says(p: float, eps: float) -> None:
    chance, wrong, count = random.Random(1), 0, 60
    for seed in range(count):
        flip = chance.randrange(100)
        known = Noise.after(round(10 * p), 10)
        wrong += searched(flip, 99, p, eps, seed=seed, noise=known).found != flip
    assert wrong <= 7  # of 60 at 5 %: more than this once in 80 times


def test_more_noise_takes_more_trials() -> None:
    trials = [searched(30, 99, p, 0.0, seed=5).trials for p in (1.0, 0.7, 0.3)]
    assert trials == sorted(trials)


def test_prior_masses_save_trials() -> None:
    masses = [1.0] * 1001
    masses[700] = 1000.0
    search = FlipSearch(masses, Noise.after(4, 4), rises=True)
    while search.confidence < 0.95:
        (position,) = search.questions()
        search.tell(position, failed=position >= 700)
    assert search.found == 700
    assert search.trials < 8


def test_several_questions_divide_what_is_left() -> None:
    search = FlipSearch([1.0] * 1001, Noise.after(4, 4), rises=True)
    positions = search.questions(3)
    assert len(positions) == 3
    parts = [0, *sorted(positions), 1000]
    assert max(b - a for a, b in pairwise(parts)) <= 500
    batches = 0
    while search.confidence < 0.95:
        for position in search.questions(3):
            search.tell(position, failed=position >= 333)
        batches += 1
    assert search.found == 333
    assert batches <= 7


def test_rates_are_learnt_from_what_was_confirmed_and_on_the_way() -> None:
    assert Noise.after(20, 20).rate > 0.98
    assert 0.2 < Noise.after(3, 10).rate < 0.5
    falsely, unknown = Noise.after(4, 4, nominal_failed=2, nominal_total=40), Noise.after(4, 4)
    assert falsely.weight @ falsely.eps > unknown.weight @ unknown.eps
    search = searched(30, 99, 0.3, 0.0, noise=Noise.after())
    assert 0.1 < search.noise.rate < 0.6


def test_one_input_is_decided_by_its_trials() -> None:
    reliable, rare = Noise.after(20, 20), Noise.after(3, 10)
    assert reliable.triggers(1, 0) > 0.99
    assert reliable.triggers(0, 1) < 0.02
    assert 0.3 < rare.triggers(0, 1) < 0.5
    assert rare.triggers(0, 15) < 0.05
    assert rare.triggers(1, 3) > 0.9
    assert reliable.triggers(0, 0, prior=0.25) == pytest.approx(0.25)


def test_answers_that_fit_no_hypothesis_leave_probabilities() -> None:
    search = FlipSearch([0.5, 0.5], Noise.after(4, 4), rises=True)
    for _ in range(200):
        search.tell(0, failed=True)
        search.tell(0, failed=False)
    assert 0.5 <= search.confidence <= 1
    assert search.noise.weight.sum() == pytest.approx(1)


def test_searches_side_by_side_are_joined() -> None:
    start = Noise.after(4, 4)
    one, other = (FlipSearch([0.9, 0.1], start, rises=True) for _ in range(2))
    one.tell(0, failed=True)
    other.tell(0, failed=False)
    after = FlipSearch([0.9, 0.1], one.noise, rises=True)
    after.tell(0, failed=False)
    assert start.joined([one.noise, other.noise]).rate == pytest.approx(after.noise.rate)
    assert start.joined([]).rate == pytest.approx(start.rate)


def test_the_spread_of_the_rate_shrinks_with_trials() -> None:
    spreads = [Noise.after(*shown).spread for shown in ((4, 4), (3, 10), (6, 20))]
    assert spreads[0] < spreads[2] < spreads[1] < 0.2
    assert Noise.after(20, 20).missed(3) < 0.001
    assert 0.2 < Noise.after(3, 10).missed(3) < 0.6


def test_thousands_of_trials_leave_a_posterior() -> None:
    """Their likelihoods are smaller than any float."""
    noise = Noise.after(600, 2000)
    assert noise.rate == pytest.approx(0.3)
    assert noise.triggers(600, 1400) == pytest.approx(1.0)
    assert noise.triggers(20, 1980) == pytest.approx(0.0)
    assert Noise.after(20, 20_000).rate == pytest.approx(0.1)  # the smallest one of the grid
    assert Noise.after(2000, 2000).triggers(1999, 0) == pytest.approx(1.0)
