"""Statistics of nominal trials: how wide bounds are, and what is a counter or a clock."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.monitors.nominal import FieldValues, bounds_of, increases, width_for

RUNS = st.lists(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=5), min_size=3, max_size=8)


@given(RUNS, st.floats(1, 100))
def test_bounds_are_around_all_nominal_values_with_room(runs: list[list[float]], width: float) -> None:
    low, high = bounds_of(runs, width)
    values = [value for run in runs for value in run]
    room = (max(values) - min(values)) / 2
    assert low <= min(values) - room
    assert high >= max(values) + room
    assert low < high


def test_fewer_trials_and_rarer_alarms_make_bounds_wider() -> None:
    assert width_for(1e-4, 5) > width_for(1e-4, 10) > width_for(1e-4, 20) > width_for(1e-2, 20)
    assert width_for(1e-5, 10_000) == pytest.approx((11.513 - 0.5772) / 1.2825, rel=1e-2), "Gumbel's quantile"


def test_maxima_of_another_trial_are_inside_as_often_as_promised() -> None:
    random, outside = Random(1), 0
    for _ in range(300):
        runs = [[random.gauss(0, 1) for _ in range(30)] for _ in range(6)]
        low, high = bounds_of(runs[:5], width_for(1e-3, 5))
        outside += not low <= min(runs[5]) <= max(runs[5]) <= high
    assert outside <= 3


def test_counters_and_clocks_increase_and_noise_does_not() -> None:
    def fields(*runs: list[float], clock: bool = False) -> list[FieldValues]:
        return [FieldValues(run, clock) for run in runs]

    count = [float(number) for number in range(8)]
    assert increases(fields(count, count[1:], count), 10, clock=False)
    assert increases(fields([0.0, 0.0, 1.0, 1.0, 2.0, 2.0], count), 10, clock=False)
    assert not increases(fields([5.0] * 8, [5.0] * 8), 10, clock=False), "constants are no counters"
    assert not increases(fields(count, [*count, 3.0]), 10, clock=False)
    drift = [[0.0, 0.3, 0.31, 0.9, 1.2, 1.5], [0.0, 0.2, 0.5, 0.9, 1.0, 1.4]]
    assert not increases(fields(*drift), 10, clock=False), "another trial may well decrease"
    assert increases(fields(*drift), 10, clock=True)
