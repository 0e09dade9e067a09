from __future__ import annotations

import math

import numpy as np
import pytest

from riot_bus.backchain.activation import Evaluation, activate
from riot_bus.backchain.encoding import Encoding, SearchField
from riot_bus.backchain.varied import Dimension, Recombination, VariedInputs

SPEED = SearchField("speed", 2.0, 1.0, -100, 100)
GEAR = SearchField("gear", 0.0, 0.5, 0, 2, integer=True, choice=True)
VARIED = VariedInputs([SPEED, GEAR], 6.0, [61, 1])
PARTS, LINES, WAVES, ALONE = VARIED.families


def test_each_way_to_vary_has_its_own_numbers() -> None:
    names = [[each.search.name for each in family] for family in VARIED.families]
    assert names == [
        [
            *(f"{field} [part {part}]" for part in (1, 2, 3) for field in ("speed", "gear")),
            "[end of part 1]",
            "[end of part 2]",
        ],
        [f"speed [point {point}]" for point in (1, 2, 3)],
        ["speed [amplitude]", "[period]"],
        ["speed [one message]", "gear [one message]", "[place of the message]"],
    ]  # a choice has no values between two others, so it goes along no line
    assert {name for name, field in VARIED.field_of.items() if field == "gear"} == {
        "gear", "gear [part 1]", "gear [part 2]", "gear [part 3]", "gear [one message]",
    }  # fmt: skip
    assert VariedInputs([], 6.0, []).families == ()
    assert len(VariedInputs([GEAR], 6.0, [1]).families) == 2


def test_a_usual_point_of_any_way_does_nothing() -> None:
    for family in VARIED.families:
        encoding = Encoding(tuple(each.search for each in family))
        assert VARIED.drives(encoding.decode(encoding.nominal)) == []


def test_a_field_has_other_values_in_parts_of_the_run_and_is_left_alone_in_others() -> None:
    ends = {"[end of part 1]": 4.0, "[end of part 2]": 1.5}
    pulse, last = VARIED.drives({"speed [part 1]": 2.0, "speed [part 2]": 50.0, "gear [part 3]": 1.0, **ends})
    assert (pulse.field, pulse.value, pulse.start, pulse.end, pulse.how) == ("speed", 50.0, 1.5, 4.0, "from 1.5 to 4 s")
    assert (last.field, last.value, last.start, last.end, last.how) == ("gear", 1.0, 4.0, None, "from 4 s on")
    assert VARIED.drives({"speed [part 2]": 50.0, "[end of part 1]": 3.0, "[end of part 2]": 3.0}) == []
    (whole,) = VARIED.drives({"speed": 7.0})
    assert (whole.value, whole.start, whole.end, whole.how) == (7.0, 0.0, None, "")


def test_a_field_moves_along_lines_and_as_a_wave_within_its_range() -> None:
    (line,) = VARIED.drives({"speed [point 1]": 2.0, "speed [point 2]": -40.0, "speed [point 3]": 2.0})
    assert (line.value, line.points) == (None, ((0.0, 2.0), (3.0, -40.0), (6.0, 2.0)))
    assert line.how == "along lines: 2 at 0 s, -40 at 3 s, 2 at 6 s"
    (wave,) = VARIED.drives({"speed [amplitude]": 150.0, "[period]": 2.0})
    times, heights = zip(*wave.points, strict=True)
    assert times[-1] >= 6.0
    assert (min(heights), max(heights)) == (-100, 100)
    assert heights[1] == pytest.approx(2 + 150 * math.sin(math.pi / 8))
    assert wave.how == "a wave of 150 around 2 with a period of 2 s"


def test_one_message_among_many_gets_a_value() -> None:
    places = [VARIED.drives({"speed [one message]": 9.0, "[place of the message]": at})[0] for at in (0.0, 0.5, 1.0)]
    assert [each.message for each in places] == [0, 30, 60]
    assert places[1].how == "in message 31 of its topic"
    (only,) = VARIED.drives({"gear [one message]": 2.0, "[place of the message]": 0.7})
    assert only.message == 0


def test_combinations_are_of_what_was_tried_of_the_ends_and_of_what_is_usual() -> None:
    tried = [np.array([0.3, 0.5]), np.array([0.4, 0.5])]
    mixed = Recombination(PARTS, tried, np.random.default_rng(0))
    usual = Encoding(tuple(each.search for each in PARTS)).nominal
    rows = np.array([mixed.ask() for _ in range(300)])
    for place, (_, field) in enumerate(PARTS):
        if field is None:
            assert len(np.unique(rows[:, place])) == 300
        else:
            known = {0.0, 1.0, float(usual[place]), *np.quantile([one[field] for one in tried], [0, 0.25, 0.75, 1])}
            assert set(rows[:, place]) <= known
            assert {0.0, 1.0} < set(rows[:, place])


def test_few_values_get_the_same_room() -> None:
    drawn = [Encoding((GEAR,)).decode([share])["gear"] for share in np.linspace(0, 1, 999)]
    assert [drawn.count(value) for value in (0.0, 1.0, 2.0)] == [333, 333, 333]


def test_the_search_goes_over_to_inputs_that_vary_once_each_field_was_followed_alone() -> None:
    asked: list[dict[str, float]] = []

    def evaluate(points):
        asked.extend(points)
        return [Evaluation(1.0, any("[part" in name for name in point)) for point in points]

    found = activate([SPEED, GEAR], evaluate, seed=0, budget=200, parallelism=3, families=VARIED.families)
    alone = [point for point in asked if point.get("speed") == 2.0 or point.get("gear") == 0.0]
    assert asked[:9] == alone[:9]
    assert found.found in asked[9:]
    assert 9 < found.runs <= 9 + 3 * (2 + len(VARIED.families))


def test_constant_inputs_that_are_used_up_give_way_at_once() -> None:
    asked: list[dict[str, float]] = []

    def evaluate(points):
        asked.extend(points)
        return [Evaluation(1.0, failed=False) for _ in points]

    activate([GEAR], evaluate, seed=0, budget=12, families=VariedInputs([GEAR], 6.0, [9]).families)
    assert [point for point in asked if "gear" in point] == [{"gear": 0.0}, {"gear": 1.0}, {"gear": 2.0}] == asked[:3]
    assert len(asked) == 12


def test_on_a_plateau_fields_are_combined() -> None:
    """The speed only counts in the third gear: no field alone comes nearer."""

    def evaluate(points):
        met = [point["gear"] == 2 and point["speed"] < -30 for point in points]
        return [Evaluation(-1.0 if one else 5.0, one) for one in met]

    fields = [SPEED, GEAR, SearchField("idle", 0.0, 1.0, -50, 50)]
    runs = [activate(fields, evaluate, seed=seed).runs for seed in range(20)]
    assert np.median(runs) <= 60
    assert max(runs) < 200


def test_a_dimension_is_a_value_or_a_time() -> None:
    assert all(isinstance(each, Dimension) for each in ALONE)
    assert [each.field for each in WAVES] == [0, None]
    assert [each.field for each in LINES] == [0, 0, 0]
