from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.vocabulary.injection import Curve, Injection, Signal


@given(st.integers(0, 500), st.integers(1, 9), st.integers(0, 9))
def test_signals_are_held_bounded_and_stateless(index: int, hold: int, seed: int) -> None:
    signal = Signal(10.0, 2.0, hold=hold, seed=seed)
    assert 8.0 <= signal.value(index) <= 12.0
    assert signal.value(index) == signal.value(index // hold * hold) == Signal(10.0, 2.0, hold, seed).value(index)


def test_a_curve_is_linear_between_its_points_and_constant_beyond() -> None:
    curve = Curve((1.0, 3.0), (10.0, 20.0))
    assert [curve.value(seconds) for seconds in (0.0, 1.0, 2.0, 3.0, 9.0)] == [10.0, 10.0, 15.0, 20.0, 20.0]
    assert Curve((0.0, 1.0), (0.0, 1.0), integer=True).value(0.7) == 1.0


@pytest.mark.parametrize(("times", "values"), [((), ()), ((0.0,), (1.0, 2.0)), ((1.0, 1.0), (1.0, 2.0))])
def test_points_of_a_curve_have_times_that_rise(times: tuple[float, ...], values: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="curve"):
        Curve(times, values)


def test_choices_stand_in_place_of_the_number() -> None:
    signal = Signal(0.5, 5.0, hold=1, choices=("on", "off"))
    assert {signal.injected(index) for index in range(50)} == {"on", "off"}


def test_rows_leave_out_what_older_versions_did_not_have() -> None:
    row = Injection("a", "x", Signal(1.0, 0.0)).row()
    assert "options" not in row
    assert "choices" not in row["value"]
    assert Injection("a", fault="tag", options=(("tag", 1),)).row()["options"] == (("tag", 1),)
