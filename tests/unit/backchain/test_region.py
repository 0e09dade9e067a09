from __future__ import annotations

import numpy as np
import pytest

from riot_bus.backchain.encoding import SearchField
from riot_bus.backchain.region import map_region

AXES = (SearchField("goal.x", 2.0, 1.0, -5000, 5000), SearchField("goal.y", 3.0, 1.0, -5000, 5000))


def zone(noise, rng):
    def ask(points):
        edges = [-80 + noise * rng.uniform(-1, 1) for _ in points]
        return [
            abs(one["goal.x"]) < 100 and -100 < one["goal.y"] < edge for one, edge in zip(points, edges, strict=True)
        ]

    return ask


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_crash_zone_of_the_paper_within_five_metres(noise):
    asked = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        start = {"goal.x": rng.uniform(-99, 99), "goal.y": rng.uniform(-99, -83), "vx": 0.5}
        found = map_region(start, AXES, zone(noise, rng), seed=seed, tolerance=5.0)
        assert found.box.edges == pytest.approx((-100, 100, -100, -80), abs=5.0)
        asked.append(len(found.samples) - 1)
    assert np.median(asked) <= 50
    assert max(asked) <= 80


def test_other_fields_keep_their_values_and_the_text_says_all():
    seen = []

    def ask(points):
        seen.extend(points)
        return zone(0.0, np.random.default_rng(0))(points)

    found = map_region({"goal.x": 0.0, "goal.y": -90.0, "vx": 0.5}, AXES, ask, seed=0, tolerance=5.0)
    assert {one["vx"] for one in seen} == {0.5}
    assert found.good


def test_sides_beyond_which_nothing_was_tried_are_told():
    low, high = AXES[0].low, AXES[0].high
    found = map_region(
        {"goal.x": 0.0, "goal.y": -90.0},
        AXES,
        lambda points: [-95 < one["goal.y"] < -85 for one in points],
        seed=0,
        tolerance=1.0,
    )
    assert found.box.ranges[0] == pytest.approx((low, high), abs=1.0)
    assert found.ends == {0, 1}
    near = map_region(
        {"goal.x": 0.0, "goal.y": -90.0},
        AXES,
        lambda points: [low + 0.3 < one["goal.x"] and -95 < one["goal.y"] < -85 for one in points],
        seed=0,
        tolerance=1.0,
    )
    assert near.ends == {1}  # at the lower end itself it passes


def test_a_zone_that_is_no_box_is_called_so():
    def diamond(points):
        return [abs(one["goal.x"]) + abs(one["goal.y"] + 90) < 50 for one in points]

    found = map_region({"goal.x": 3.0, "goal.y": -90.0}, AXES, diamond, seed=0, tolerance=5.0)
    assert not found.good


def test_misleading_rays_are_repaired():
    def notched(points):
        # The ray towards larger x meets a notch in the lower edge, far before the zone ends.
        return [
            abs(one["goal.x"]) < 100
            and -100 < one["goal.y"] < -80
            and not (20 < one["goal.x"] < 90 and one["goal.y"] < -98)
            for one in points
        ]

    found = map_region({"goal.x": 0.0, "goal.y": -98.5}, AXES, notched, seed=2, tolerance=5.0)
    assert found.box.ranges[0][1] == pytest.approx(100, abs=5.0)


def test_zone_that_fills_the_range_and_small_budgets():
    everything = map_region(
        {"goal.x": 0.0, "goal.y": 0.0}, AXES, lambda points: [True] * len(points), seed=0, tolerance=5.0
    )
    assert everything.box.edges == (-5000, 5000, -5000, 5000)
    count = []

    def ask(points):
        count.extend(points)
        return zone(0.0, np.random.default_rng(0))(points)

    map_region({"goal.x": 0.0, "goal.y": -90.0}, AXES, ask, seed=0, budget=7, tolerance=5.0)
    assert len(count) == 7


def test_equal_seeds_give_equal_regions_and_bad_numbers_are_refused():
    start = {"goal.x": 0.0, "goal.y": -90.0}
    ask = zone(0.0, np.random.default_rng(0))
    assert map_region(start, AXES, ask, seed=3, tolerance=(2.0, 1.0)) == map_region(
        start, AXES, ask, seed=3, tolerance=(2.0, 1.0)
    )
    with pytest.raises(ValueError, match="tolerance"):
        map_region(start, AXES, ask, seed=3, tolerance=0.0)


def test_progress_counts_points_up_to_the_budget():
    told = []
    start = {"goal.x": 0.0, "goal.y": -90.0}
    ask = zone(0.0, np.random.default_rng(0))
    found = map_region(start, AXES, ask, seed=0, budget=9, tolerance=5.0, progress=lambda *words: told.append(words))
    assert [done for done, _, _ in told][-1] == 9 == len(found.samples) - 1
    assert {total for _, total, _ in told} == {9}
    assert all(text for _, _, text in told)


def test_a_zone_beside_the_end_of_a_range_ends_there():
    def corner(points):
        return [one["goal.x"] > 4990 and one["goal.y"] > 4000 for one in points]

    found = map_region({"goal.x": 4995.0, "goal.y": 4500.0}, AXES, corner, seed=1, tolerance=5.0)
    assert found.box.edges[1::2] == (5000, 5000)
    assert found.box.ranges[0][0] == pytest.approx(4990, abs=5)
    assert found.box.ranges[1][0] == pytest.approx(4000, abs=5)


def test_a_zone_that_ends_just_before_the_end_of_a_range_is_probed_up_to_there():
    asked = []

    def ask(points):
        asked.extend(points)
        return [4000 < one["goal.x"] < 4998 and abs(one["goal.y"]) < 500 for one in points]

    found = map_region({"goal.x": 4500.0, "goal.y": 0.0}, AXES, ask, seed=1, tolerance=5.0)
    assert found.box.ranges[0][1] == pytest.approx(4998, abs=5)
    assert max(one["goal.x"] for one in asked) == 5000
    assert found.good


def test_an_edge_that_never_comes_to_rest_ends_with_the_rounds():
    rng = np.random.default_rng(7)

    def shaking(points):
        return [
            abs(one["goal.x"]) < rng.uniform(50, 200) and abs(one["goal.y"]) < rng.uniform(50, 200) for one in points
        ]

    found = map_region({"goal.x": 0.0, "goal.y": 0.0}, AXES, shaking, seed=0, budget=2000, tolerance=1.0)
    assert not found.good
    assert len(found.samples) < 2000


def test_one_field_has_an_interval():
    def inside(points):
        return [20 < one["goal.x"] < 300 for one in points]

    found = map_region({"goal.x": 50.0, "vx": 1.0}, AXES[:1], inside, seed=0, tolerance=1.0)
    assert found.box.edges == pytest.approx((20, 300), abs=1.0)
    assert found.good
    assert len(found.samples) < 40


@pytest.mark.parametrize("seed", range(5))
def test_three_fields_have_a_box(seed):
    axes = (*AXES, SearchField("vx", 0.5, 0.2, -10, 10))

    def ask(points):
        return [abs(one["goal.x"]) < 100 and -100 < one["goal.y"] < -80 and one["vx"] > 2 for one in points]

    start = {"goal.x": 10.0, "goal.y": -90.0, "vx": 4.0}
    found = map_region(start, axes, ask, seed=seed, budget=120, tolerance=(5.0, 2.0, 0.2))
    assert found.box.edges == pytest.approx((-100, 100, -100, -80, 2, 10), abs=5.0)
    assert found.box.ranges[2] == pytest.approx((2, 10), abs=0.2)
    assert found.ends == {5}
    assert found.good


def test_axes_have_to_be_different_fields():
    for axes in ((), (AXES[0], AXES[0])):
        with pytest.raises(ValueError, match="no region map"):
            map_region({"goal.x": 1.0}, axes, lambda points: [True] * len(points), seed=0, tolerance=1.0)


def test_large_steps_do_not_miss_the_nominal_values():
    """It fails beyond 60 on either side of nominal: the zone around 175 ends at 60, not at the end of the range."""
    found = map_region(
        {"goal.x": 175.0}, AXES[:1], lambda points: [abs(one["goal.x"]) > 60 for one in points], seed=0, tolerance=1.0
    )
    assert found.box.edges == pytest.approx((60, 5000), abs=1.0)
    assert found.ends == {1}
