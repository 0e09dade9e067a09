from __future__ import annotations

import sys

import pytest

from riot_bus.backchain.extras import clopper_pearson, student_reach
from riot_bus.vocabulary.errors import MissingExtraError


def test_an_exact_interval_holds_the_rate_and_ends_where_nothing_or_all_was_hit():
    assert clopper_pearson(0, 10) == (0.0, pytest.approx(0.3085, abs=1e-4))
    assert clopper_pearson(10, 10) == (pytest.approx(0.6915, abs=1e-4), 1.0)
    low, high = clopper_pearson(3, 10)
    assert 0 < low < 0.3 < high < 1


def test_few_degrees_of_freedom_reach_far():
    assert student_reach(1) == pytest.approx(12.706, abs=1e-3)
    assert student_reach(10_000) == pytest.approx(1.960, abs=1e-3)


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.special", None)
    with pytest.raises(MissingExtraError, match="scipy"):
        student_reach(3)
    with pytest.raises(MissingExtraError, match="scipy"):
        clopper_pearson(1, 2)
