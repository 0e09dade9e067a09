import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.log.playback.lateness import Lateness


@given(st.lists(st.integers(-5, 10**12), min_size=1), st.floats(0.01, 1))
def test_quantiles_are_exact_to_two_percent(delays, share):
    lateness = Lateness()
    for delay in delays:
        lateness.add(delay)
    ordered = sorted(max(0, delay) for delay in delays)
    exact = next(delay for place, delay in enumerate(ordered, 1) if place >= share * len(ordered) - 1e-9)
    assert lateness.quantile(share) * 1e9 == pytest.approx(exact, rel=0.017, abs=1)
    assert lateness.worst * 1e9 == pytest.approx(ordered[-1])
    assert lateness.count == len(delays)


def test_nothing_is_never_late():
    assert (Lateness().quantile(0.99), Lateness().worst) == (0.0, 0.0)
