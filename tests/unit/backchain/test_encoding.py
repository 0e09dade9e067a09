from __future__ import annotations

import math

import numpy as np
import pytest

from riot_bus.backchain.encoding import Encoding, SearchField

GOAL = SearchField("goal.x", 2.0, 1.0, -5000.0, 5000.0)
COUNT = SearchField("count", 10.0, 3.0, 0.5, 1000.5, integer=True)
MODE = SearchField("mode", 1.0, 1.0, 0.0, 4.0, integer=True)
ALL = Encoding((GOAL, COUNT, MODE))


def test_the_scale_is_linear_near_nominal_and_logarithmic_beyond() -> None:
    assert GOAL.encode(2.0) == 0.0
    assert GOAL.encode(2.01) == pytest.approx(0.01, rel=1e-3)
    assert GOAL.encode(2.0 - 50) == -GOAL.encode(2.0 + 50)
    assert GOAL.encode(1002.0) - GOAL.encode(102.0) == pytest.approx(math.log(10), rel=1e-3)


@pytest.mark.parametrize(
    ("value", "sensible"), [(2.00061, 2.001), (27.56789, 27.57), (-1234.567, -1235.0), (9e9, 5000)]
)
def test_values_have_only_the_digits_that_make_a_difference(value: float, sensible: float) -> None:
    assert GOAL.sensible(value) == sensible
    assert GOAL.sensible(sensible) == sensible


def test_decoding_inverts_encoding_as_far_as_digits_make_a_difference() -> None:
    for field in ALL.fields:
        for value in (field.low, -3.21, 0.0, 2.0, 3.5, 77.7, field.high):
            kept = field.sensible(value)
            assert field.decode(field.encode(kept)) == kept


def test_whole_numbers_stay_whole_and_in_the_range() -> None:
    assert [COUNT.sensible(value) for value in (-7, 0.6, 3.4, 1000.5, 2000)] == [1, 1, 3, 1000, 1000]
    assert (COUNT.few, MODE.few, GOAL.few) == (False, True, False)


def test_few_values_get_equal_shares_of_the_vector() -> None:
    modes = [Encoding((MODE,)).decode([share])["mode"] for share in np.linspace(0, 1, 500)]
    assert modes == sorted(modes)
    assert [modes.count(mode) for mode in range(5)] == pytest.approx([100] * 5, abs=2)


def test_vectors_reach_from_0_to_1_and_back() -> None:
    assert ALL.size == 3
    low, high = ({field.name: end(field) for field in ALL.fields} for end in (lambda f: f.low, lambda f: f.high))
    assert ALL.encode(low)[0] == 0.0
    assert ALL.encode(high)[0] == 1.0
    assert ALL.decode(ALL.nominal) == {"goal.x": 2.0, "count": 10.0, "mode": 1.0}
    assert ALL.decode([-1, 0.0, 2.0]) == {"goal.x": -5000.0, "count": 1.0, "mode": 4.0}
    assert ALL.encode({"goal.x": 1e9, "count": -1e9, "mode": 9}).tolist() == [1.0, 0.0, 1.0]


def test_the_usual_value_is_the_nominal_one_as_a_search_sets_it() -> None:
    assert SearchField("x", 2.12345678, 1.0, 0.0, 9.0).usual == 2.123
    assert SearchField("x", 12.0, 1.0, 0.0, 9.0).usual == 9.0
    assert SearchField("x", 2.6, 1.0, 0.0, 9.0, integer=True).usual == 3.0


@pytest.mark.parametrize(
    ("nominal", "spread", "low", "high"),
    [
        *[(0, spread, 0, 1) for spread in (0, -1, math.nan, math.inf)],
        *[(0, 1, low, high) for low, high in ((1, 1), (2, 1), (0, math.inf), (-1.7e308, 1.7e308))],
        (math.nan, 1, 0, 1),
    ],
)
def test_what_has_no_scale_is_refused(nominal: float, spread: float, low: float, high: float) -> None:
    with pytest.raises(ValueError, match="x: "):
        SearchField("x", nominal, spread, low, high)
