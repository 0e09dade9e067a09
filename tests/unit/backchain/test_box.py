from __future__ import annotations

import pytest

from riot_bus.backchain.box import Box, RegionSample, fit_box


def line(failing: range, values: range) -> list[RegionSample]:
    return [RegionSample((float(value),), value in failing) for value in values]


def test_edges_belong_to_the_box_and_one_field_may_be_ignored() -> None:
    box = Box((0.0, 2.0, 10.0, 14.0))
    assert box.ranges == ((0.0, 2.0), (10.0, 14.0))
    assert box.spans == (2.0, 4.0)
    assert box.contains((0.0, 14.0))
    assert not box.contains((2.1, 12.0))
    assert box.contains((2.1, 12.0), but=0)
    assert not box.contains((2.1, 14.5), but=0)


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ((0.5, 12.0), 0.5),  # inside, half a width of the first field from its lower edge
        ((1.0, 13.0), 0.25),  # inside, a quarter of a width of the second field from its upper edge
        ((5.0, 12.0), 3.0),
        ((2.5, 22.0), 2.0),  # outside in both: what is farther decides
    ],
)
def test_clearance_is_in_units_of_the_widths(place: tuple[float, ...], expected: float) -> None:
    assert Box((0.0, 2.0, 10.0, 14.0)).clearance(place, (1.0, 4.0)) == pytest.approx(expected)


def test_edges_end_midway_between_what_fails_and_what_passes() -> None:
    assert fit_box(line(range(11), range(-5, 16)), Box((2.0, 3.0))).edges == (-0.5, 10.5)
    assert fit_box(line(range(11), range(-5, 16)), Box((-4.0, 15.0))).edges == (-0.5, 10.5)


def test_beyond_the_last_sample_nothing_is_claimed() -> None:
    assert fit_box(line(range(11), range(11)), Box((2.0, 3.0))).edges == (0.0, 10.0)
    assert fit_box([], Box((2.0, 3.0))).edges == (2.0, 3.0)


def test_one_contradicting_sample_does_not_move_an_edge() -> None:
    samples = line(range(11), range(-5, 16))
    assert fit_box([*samples, RegionSample((13.0,), True)], Box((2.0, 3.0))).edges == (-0.5, 10.5)
    assert fit_box([*samples, RegionSample((8.2,), False)], Box((2.0, 3.0))).edges == (-0.5, 10.5)


def test_two_fields_are_fitted_each_within_the_range_of_the_other() -> None:
    grid = [(float(x), float(y)) for x in range(10) for y in range(10)]
    samples = [RegionSample(place, 2 <= place[0] <= 5 and 6 <= place[1] <= 7) for place in grid]
    assert fit_box(samples, Box((3.0, 4.0, 6.0, 7.0))).edges == (1.5, 5.5, 5.5, 7.5)
