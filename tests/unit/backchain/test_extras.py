from __future__ import annotations

import sys

import pytest

from riot_bus.backchain.extras import student_reach
from riot_bus.vocabulary.errors import MissingExtraError


def test_few_degrees_of_freedom_reach_far():
    assert student_reach(1) == pytest.approx(12.706, abs=1e-3)
    assert student_reach(10_000) == pytest.approx(1.960, abs=1e-3)


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.special", None)
    with pytest.raises(MissingExtraError, match="scipy"):
        student_reach(3)
