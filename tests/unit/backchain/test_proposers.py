from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from riot_bus.backchain.proposers import Evolution, Forest, History, Proposer, Simplex, proposers
from riot_bus.vocabulary.errors import ConfigError

BEST = np.array([0.7, 0.2])
NOMINAL = np.array([0.5, 0.5])


def value(vector: np.ndarray) -> float:
    return float(((vector - BEST) ** 2).sum())


def history_of(*vectors: tuple[float, ...]) -> History:
    history = History()
    for each in vectors:
        history.add(np.array(each), value(np.array(each)))
    return history


def search(method: Proposer, history: History, asked: int) -> list[np.ndarray]:
    found = []
    while len(found) < asked and (vector := method.ask()) is not None:
        found.append(vector)
        history.add(vector, value(vector))
        method.tell(vector, value(vector))
    return found


def test_the_history_ranks_the_earlier_one_first_among_equals() -> None:
    history = History()
    for each in (3.0, 1.0, 2.0, 1.0):
        history.add(NOMINAL, each)
    assert history.ranked() == [1, 3, 2, 0]


def test_the_simplex_finds_a_minimum_and_asks_for_one_vertex_at_a_time() -> None:
    history = history_of((0.5, 0.5), (0.1, 0.9))
    simplex = Simplex(history, NOMINAL, np.random.default_rng(0))
    assert simplex.ask() is not None
    assert simplex.ask() is None
    simplex = Simplex(history, NOMINAL, np.random.default_rng(0))
    found = search(simplex, history, 80)
    assert len(found) == 80
    assert all(((each >= 0) & (each <= 1)).all() for each in found)
    assert min(map(value, found)) < 1e-5
    assert Simplex(History(), NOMINAL, np.random.default_rng(0)).ask() is None


def test_a_simplex_begins_with_points_in_different_directions() -> None:
    history = history_of((0.7, 0.21), (0.6, 0.21), (0.5, 0.211), (0.7, 0.6))
    start = Simplex(history, NOMINAL, np.random.default_rng(0))._start()
    assert [point.tolist() for _, point in start] == [[0.7, 0.21], [0.6, 0.21], [0.7, 0.6]]


def test_a_simplex_that_has_shrunk_starts_anew_from_what_others_have_found() -> None:
    history = history_of((0.7, 0.21))
    simplex = Simplex(history, NOMINAL, np.random.default_rng(0))
    search(simplex, history, 100)
    history.add(np.array([0.1, 0.9]), -1.0)
    assert min(float(np.abs(each - [0.1, 0.9]).max()) for each in search(simplex, history, 50)) < 0.3


def test_a_forest_waits_for_five_points() -> None:
    history = history_of(*[(0.1, 0.2)] * 4)
    assert Forest(history, NOMINAL, np.random.default_rng(0)).ask() is None


def test_a_forest_looks_near_the_best_points_and_elsewhere() -> None:
    vectors = np.array([[0.9, 0.1]] * 8 + [[0.0, 0.0]] * 20)
    candidates = Forest(History(), NOMINAL, np.random.default_rng(0))._candidates(vectors)
    assert candidates.min() >= 0
    assert candidates.max() <= 1
    near = np.abs(candidates - vectors[0]).max(axis=1) < 0.1
    assert 60 < near.sum() < 240
    assert not (candidates == vectors[0]).all(axis=1).any()


class Engine:
    """In place of `cmaes.CMA`, which takes two seconds to import."""

    made: ClassVar[list[Engine]] = []

    def __init__(self, *, mean: np.ndarray, population_size: int, **_: object) -> None:
        self.mean, self.population_size, self.told = mean, population_size, 0
        self.made.append(self)

    def ask(self) -> np.ndarray:
        return self.mean + 2

    def tell(self, answers: list[tuple[np.ndarray, float]]) -> None:
        assert len(answers) == self.population_size
        self.told += 1

    def should_stop(self) -> bool:
        return False


@pytest.fixture
def engines(monkeypatch: pytest.MonkeyPatch) -> list[Engine]:
    monkeypatch.setitem(sys.modules, "cmaes", SimpleNamespace(CMA=Engine))
    monkeypatch.setattr(Engine, "made", [])
    return Engine.made


def test_an_evolution_asks_for_a_whole_generation_before_it_needs_values(engines: list[Engine]) -> None:
    evolution = Evolution(History(), NOMINAL, np.random.default_rng(1))
    size = engines[0].population_size
    asked = [evolution.ask() for _ in range(size + 2)]
    assert [each is None for each in asked] == [False] * size + [True] * 2
    for vector in asked[:size]:
        assert vector is not None
        assert vector.tolist() == [1.0, 1.0]
        assert evolution.ask() is None
        evolution.tell(vector, 0.0)
    assert engines[0].told == 1
    assert evolution.ask() is not None


def test_an_evolution_that_gets_no_better_restarts_larger_at_random_then_at_the_nominal_point(
    engines: list[Engine],
) -> None:
    evolution = Evolution(History(), NOMINAL, np.random.default_rng(1))
    better = 0.0
    while engines[0].told < 30:  # as long as it gets better, it goes on
        better -= 1
        evolution.tell(NOMINAL, better)
    assert len(engines) == 1
    while len(engines) < 3:
        evolution.tell(NOMINAL, 0.0)
    assert engines[0].told == 30 + 12
    assert engines[0].mean.tolist() == engines[2].mean.tolist() == NOMINAL.tolist()
    assert engines[1].mean.tolist() != NOMINAL.tolist()
    assert engines[0].population_size < engines[1].population_size < engines[2].population_size


def test_methods_draw_differently_and_those_for_more_dimensions_are_left_out() -> None:
    found = proposers([Simplex, Simplex, Evolution], History(), np.array([0.5]), [7])
    assert [type(each) for each in found] == [Simplex, Simplex]
    first, second = (each._rng.random() for each in found)  # type: ignore[attr-defined]
    assert first != second
    again = proposers([Simplex], History(), np.array([0.5]), [7])
    assert again[0]._rng.random() == first  # type: ignore[attr-defined]
    with pytest.raises(ConfigError, match="no search method is left for 1 field"):
        proposers([Evolution], History(), np.array([0.5]), [7])
