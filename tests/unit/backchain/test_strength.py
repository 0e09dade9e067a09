from __future__ import annotations

import sys

import numpy as np
import pytest

from riot_bus.backchain.strength import estimate, student_reach
from riot_bus.vocabulary.errors import MissingExtraError


def test_the_share_of_each_field_is_found_with_its_column():
    rng = np.random.default_rng(2)
    designs = {name: rng.normal(size=(400, 3)) for name in ("a", "b", "c")}
    response = 2 * designs["a"][:, 1] + designs["b"][:, 2] + rng.normal(size=400)
    groups = np.repeat(np.arange(8), 50)
    shares = estimate(response, designs, selected=["a", "b"], asked=["a", "b", "c"], groups=groups)
    a, b, c = shares
    assert (a.name, a.column, b.column) == ("a", 1, 2)
    assert a.strength == pytest.approx(4 / 6, abs=0.08)
    assert b.strength == pytest.approx(1 / 6, abs=0.08)
    assert c.strength < 0.03
    assert all(0 <= one.low <= one.strength <= one.high <= 1 for one in shares)


def test_fewer_than_four_runs_are_cut_into_blocks():
    rng = np.random.default_rng(3)
    design = rng.normal(size=(90, 2))
    (one,) = estimate(
        design[:, 0] + 0.1 * rng.normal(size=90), {"a": design}, selected=["a"], asked=["a"], groups=np.zeros(90, int)
    )
    assert 0.9 < one.low <= one.strength <= one.high <= 1.0


def test_too_few_samples_and_constant_answers_show_no_strength():
    rng = np.random.default_rng(4)
    few = rng.normal(size=(4, 2))
    (one,) = estimate(few[:, 0], {"a": few}, selected=[], asked=["a"], groups=np.arange(4))
    assert one.strength >= 0
    (none,) = estimate(np.zeros(40), {"a": np.zeros((40, 2))}, selected=[], asked=["a"], groups=np.arange(40) % 4)
    assert (none.strength, none.low, none.high) == (0.0, 0.0, 0.0)
    (tiny,) = estimate(few[:2, 0], {"a": few[:2]}, selected=[], asked=["a"], groups=np.arange(2))
    assert tiny.strength == 0.0


def test_few_degrees_of_freedom_reach_far():
    assert student_reach(1) == pytest.approx(12.706, abs=1e-3)
    assert student_reach(10_000) == pytest.approx(1.960, abs=1e-3)


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.special", None)
    with pytest.raises(MissingExtraError, match="scipy"):
        student_reach(3)
