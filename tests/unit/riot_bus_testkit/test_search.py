"""The shipped search methods hold what methods promise; broken ones are found out."""

from __future__ import annotations

import numpy as np
import pytest

from riot_bus.backchain.proposers import PORTFOLIO, Evolution, Forest, Simplex, proposers
from riot_bus.backchain.proposers import History as Evaluations
from riot_bus.plugins import SEARCHES
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_testkit.search import SearchConformance

pytest.importorskip("sklearn")
pytest.importorskip("cmaes")


class TestSimplex(SearchConformance):
    method = Simplex


class TestForest(SearchConformance):
    method = Forest
    rounds = 20


class TestEvolution(SearchConformance):
    method = Evolution
    rounds = 160


class Guess:
    """Draws vectors from a bowl around the best one."""

    def __init__(self, history, nominal, rng):
        self.history, self.rng = history, rng

    def ask(self):
        best = self.history.vectors[self.history.ranked()[0]]
        return np.clip(best + self.rng.normal(scale=0.05, size=len(best)), 0.0, 1.0)

    def tell(self, vector, value):
        pass


class TestGuess(SearchConformance):
    method = Guess
    rounds = 200


class Outside(Guess):
    def ask(self):
        return super().ask() + 1.0


class Restless(Guess):
    def ask(self):
        return np.clip(super().ask() + np.random.default_rng().normal(scale=1e-6), 0.0, 1.0)


class Lazy(Guess):
    def ask(self):
        return self.rng.normal(loc=0.5, scale=0.01, size=len(self.history.vectors[0]))


class Stuck(Guess):
    def ask(self):
        return super().ask() if len(self.history.vectors) < 20 else None


class Fragile(Guess):
    def tell(self, vector, value):
        assert value == value


@pytest.mark.parametrize(
    ("method", "test"),
    [
        (Outside, "test_it_stays_in_bounds"),
        (Lazy, "test_it_gets_nearer_than_its_start"),
        (Stuck, "test_it_gives_as_many_as_are_asked_for"),
    ],
)
def test_broken_methods_are_found(method, test):
    broken = type("Broken", (SearchConformance,), {"method": method})()
    with pytest.raises(AssertionError):
        getattr(broken, test)(3)


@pytest.mark.parametrize(
    ("method", "test"),
    [(Restless, "test_it_repeats_itself"), (Fragile, "test_strange_inputs_are_survived")],
)
def test_restless_and_fragile_methods_are_found(method, test):
    with pytest.raises(AssertionError):
        getattr(type("Broken", (SearchConformance,), {"method": method})(), test)()


def test_the_shipped_methods_are_plug_ins():
    assert [SEARCHES.load(name) for name in ("simplex", "forest", "evolution")] == list(PORTFOLIO)


def test_methods_for_more_fields_are_left_out():
    nominal = np.full(1, 0.5)
    assert [type(each) for each in proposers(PORTFOLIO, Evaluations(), nominal, [0])] == [Simplex, Forest]
    with pytest.raises(ConfigError, match="no search method is left for 1 field"):
        proposers([Evolution], Evaluations(), nominal, [0])
