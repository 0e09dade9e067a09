"""Quantities of the elements of an array."""

from __future__ import annotations

import math

import pytest

from riot_bus.vocabulary.elements import QUANTITIES, Elements, is_counted, quantity_of
from riot_bus.vocabulary.selector import parse_selector


@pytest.mark.parametrize(
    ("elements", "quantities"),
    [
        ((3, -1, 2), (3, -1, False, False)),
        ((math.nan, 2.0), (2.0, 2.0, True, True)),
        ((math.inf, 2.0), (math.inf, 2.0, False, True)),
        ((-math.inf, 2.0), (2.0, -math.inf, False, True)),
        ((2**64 - 1, 2**64 - 2), (2**64 - 1, 2**64 - 2, False, False)),
    ],
)
def test_quantities(elements: tuple[float, ...], quantities: tuple[object, ...]) -> None:
    assert tuple(read(Elements(elements)) for read in QUANTITIES.values()) == quantities


def test_without_a_number_there_is_no_largest_one() -> None:
    for elements in (Elements(()), Elements([math.nan])):
        assert math.isnan(elements.largest)
        assert math.isnan(elements.smallest)


def test_elements_are_told_apart_bit_by_bit() -> None:
    keys = [Elements(each).key for each in ((0.0,), (-0.0,), (0,), (math.nan,))]
    assert len(set(keys)) == 4
    assert Elements([math.nan]).key == keys[3]


def test_names() -> None:
    assert quantity_of("/scan[1]:max(a.ranges[*].x)") == ("/scan[1]:", "max", "a.ranges[*].x")
    assert quantity_of("min(r[*])") == ("", "min", "r[*]")
    assert [quantity_of(name) for name in ("/scan:ranges[3]", "/scan:len(r)", "/scan:sum(r[*])", "max(r)")] == [
        None
    ] * 4
    assert is_counted("/scan:len(r)")
    assert is_counted("/scan:isnan(r[*])")
    assert not is_counted("/scan:r[0]")
    assert parse_selector("/scan:max(a.ranges[*].x)").field == "max(a.ranges[*].x)"
