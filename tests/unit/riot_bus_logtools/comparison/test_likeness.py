from __future__ import annotations

import math

import numpy as np
import pytest

from riot_bus.types.registry import TypeRegistry
from riot_bus_logtools.comparison.fields import Shapes
from riot_bus_logtools.comparison.likeness import MOST_FIELDS, Likeness, as_numbers, most_varied
from riot_bus_logtools.comparison.tolerances import EXACT, tolerances_of
from tests.unit.riot_bus_logtools.comparison.recordings import said


def readings(rows, *texts: str):
    shapes = Shapes(tolerances_of(texts).of_topic(lambda text: True))
    registry = TypeRegistry()
    return [shapes.read(message, registry) for message in said(*rows)]


def costs(rows_a, rows_b, *texts: str):
    """The costs of all pairs."""
    a, b = readings(rows_a, *texts), readings(rows_b, *texts)
    rules = most_varied(a + b)
    numbers = [as_numbers(some, list(rules)) for some in (a, b)]
    likeness = Likeness(numbers[0][0], numbers[1][0], texts=numbers[0][1] | numbers[1][1], rules=rules)
    return likeness.costs(np.arange(len(a))[:, None], np.arange(len(b))[None, :].repeat(len(a), axis=0))


def test_the_fields_that_vary_most_are_chosen():
    rows = [{"same": 1, "few": n % 2, "many": n, "header": {"stamp": n}, "left": n} for n in range(10)]
    assert list(most_varied(readings(rows, "a:left=ignore"))) == ["many", "few"]
    assert list(most_varied(readings([{"x": 1}, {"x": 1, "y": 1}]))) == ["y"]
    wide = [{f"f{number}": n for number in range(100)} for n in range(3)]
    assert len(most_varied(readings(wide))) == MOST_FIELDS


def test_equal_messages_cost_nothing_and_others_at_least_one():
    found = costs([{"x": 1.0, "t": "a"}, {"x": 2.0, "t": "b"}], [{"x": 1.0, "t": "a"}, {"x": 2.0, "t": "a"}])
    assert found[0, 0] == 0.0
    assert 1.0 < found[1, 1] < 1.01
    assert 1.0 < found[0, 1] < found[1, 0] < 1.02


def test_what_is_tolerated_costs_little():
    found = costs([{"x": 1.0, "y": 5}], [{"x": 1.5, "y": 5}, {"x": 3.0, "y": 5}], "a:x=1")
    assert 0.0 < found[0, 0] < 0.01
    assert found[0, 1] > 1.0


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e308, -1e308, True, "text"])
def test_odd_values_are_like_themselves_alone(value):
    found = costs([{"x": value}, {"x": 0}], [{"x": value}, {"x": 1}, {}], "a:x=50%")
    assert found[0, 0] == 0.0
    assert (found[0, 1:] >= 1.0).all()


def test_without_any_field_all_are_alike():
    assert costs([{"x": 1}], [{"x": 1}]).tolist() == [[0.0]]
    assert most_varied([]) == {}
    assert Likeness(np.zeros((2, 0)), np.zeros((1, 0)), texts=np.zeros(0, np.bool_), rules={}).costs(
        np.arange(2)[:, None], np.zeros((2, 1), np.int64)
    ).tolist() == [[0.0], [0.0]]
    assert EXACT.absolute == 0.0
