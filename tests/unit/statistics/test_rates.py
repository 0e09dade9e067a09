from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.statistics.rates import chance_of_difference, exact_interval, proportion


@pytest.mark.parametrize(
    ("hits", "total", "low", "high"),
    [(10, 10, 0.6915, 1.0), (0, 10, 0.0, 0.3085), (5, 10, 0.1871, 0.8129), (0, 0, 0.0, 1.0), (98, 100, 0.9296, 0.9976)],
)
def test_exact_interval(hits: int, total: int, low: float, high: float) -> None:
    assert exact_interval(hits, total) == pytest.approx((low, high), abs=1e-4)


@settings(deadline=None)  # importing scipy takes longer
@given(st.integers(1, 300), st.data())
def test_it_agrees_with_the_beta_distribution(total: int, data: st.DataObject) -> None:
    special = pytest.importorskip("scipy.special")
    hits = data.draw(st.integers(0, total))
    low = special.betaincinv(hits, total - hits + 1, 0.025) if hits else 0.0
    high = special.betaincinv(hits + 1, total - hits, 0.975) if hits < total else 1.0
    assert exact_interval(hits, total) == pytest.approx((low, high), abs=1e-9)


def test_a_proportion_of_nothing_says_nothing() -> None:
    nothing = proportion(0, 0)
    assert (nothing.rate, nothing.low, nothing.high) == (1.0, 0.0, 1.0)


def test_more_confidence_needs_a_wider_interval() -> None:
    usual, surer = proportion(27, 30), proportion(27, 30, confidence=0.99)
    assert surer.low < usual.low < usual.rate < usual.high < surer.high


@given(data=st.data())
@settings(deadline=None)
def test_the_chance_of_a_difference_is_fishers(data: st.DataObject) -> None:
    from scipy import stats

    total, others = data.draw(st.integers(1, 20)), data.draw(st.integers(1, 20))
    hits, other_hits = data.draw(st.integers(0, total)), data.draw(st.integers(0, others))
    table = [[hits, total - hits], [other_hits, others - other_hits]]
    assert chance_of_difference(hits, total, other_hits, others) == pytest.approx(
        stats.fisher_exact(table, alternative="greater").pvalue, abs=1e-9
    )
