from __future__ import annotations

import random
from itertools import pairwise

import numpy as np
import pytest

from riot_bus_logtools.comparison import band
from riot_bus_logtools.comparison.band import aligned


def of(table):
    """The costs of a table, by row and column."""
    numbers = np.array(table, np.float64).reshape(len(table), -1)
    return lambda rows, columns: numbers[rows, columns].copy()


def unlike(a, b):
    return of([[float(x != y) for y in b] for x in a])


def least(table, count_a, count_b):
    """The cost of the best alignment, without any band."""
    best = np.full((count_a + 1, count_b + 1), np.inf)
    best[0, :] = np.arange(count_b + 1)
    best[:, 0] = np.arange(count_a + 1)
    for i in range(1, count_a + 1):
        for j in range(1, count_b + 1):
            best[i, j] = min(best[i - 1, j - 1] + table[i - 1][j - 1], best[i - 1, j] + 1, best[i, j - 1] + 1)
    return best[count_a, count_b]


@pytest.mark.parametrize(
    ("a", "b", "pairs"),
    [
        ("abc", "abc", [(0, 0), (1, 1), (2, 2)]),
        ("abc", "ac", [(0, 0), (2, 1)]),
        ("ac", "abc", [(0, 0), (1, 2)]),
        ("abc", "aXc", [(0, 0), (1, 1), (2, 2)]),
    ],
)
def test_what_belongs_together(a, b, pairs):
    assert aligned(unlike(a, b), len(a), len(b)) == pairs


def test_it_costs_no_more_than_the_best_alignment():
    rng = random.Random(3)
    for _ in range(60):
        count_a, count_b = rng.randint(1, 14), rng.randint(1, 14)
        table = [[rng.choice([0.0, 0.004, 1.0, 1.008]) for _ in range(count_b)] for _ in range(count_a)]
        pairs = aligned(of(table), count_a, count_b)
        assert pairs is not None
        assert all(x < y and u < v for (x, u), (y, v) in pairwise(pairs))
        cost = sum(table[i][j] for i, j in pairs) + count_a + count_b - 2 * len(pairs)
        assert cost == pytest.approx(least(table, count_a, count_b))


def test_of_equal_costs_the_nearer_ones_belong_together():
    a, b = [0.0, 1.0, 2.0, 3.0, 4.0], [0.1, 1.1, 3.1, 4.1]
    table = [[1.0 + 0.01 * abs(x - y) for y in b] for x in a]
    assert aligned(of(table), 5, 4) == [(0, 0), (1, 1), (3, 2), (4, 3)]


def test_what_would_take_too_long_is_not_aligned(monkeypatch):
    monkeypatch.setattr(band, "MOST_CELLS", 50)
    assert aligned(unlike("a" * 10, "a" * 10), 10, 10) == [(n, n) for n in range(10)]
    assert aligned(unlike("a" * 11, "a" * 11), 11, 11) is None
    assert aligned(unlike("a" * 10, "a" * 20), 10, 20) is None


def test_many_rows_are_worked_off_in_parts(monkeypatch):
    monkeypatch.setattr(band, "_AT_ONCE", 16)
    a, b = list(range(200)), [n for n in range(200) if n != 77]
    assert aligned(unlike(a, b), 200, 199) == [(n, n - (n > 77)) for n in range(200) if n != 77]
