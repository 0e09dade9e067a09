from __future__ import annotations

import math
from xml.etree import ElementTree

import pytest

from riot_bus.report.svg import Axis, element, text, width_of


def test_elements_escape_what_others_wrote() -> None:
    drawn = ElementTree.fromstring(element("g", text('<b a="1">', 1, 2.25, size=9.5, fill="red"), id='"'))
    assert drawn.attrib == {"id": '"'}
    (words,) = drawn
    assert words.text == '<b a="1">'
    assert words.attrib == {"x": "1", "y": "2.2", "font-size": "9.5", "fill": "red", "text-anchor": "middle"}


def test_wide_letters_take_more_room() -> None:
    assert width_of("地図", 10) == 20
    assert width_of("ab", 10) == 12


@pytest.mark.parametrize(
    ("axis", "labels"),
    [
        (Axis(-170, 170), ["-120", "-60", "0", "60", "120"]),
        (Axis(0, 1), ["0", "0.2", "0.4", "0.6", "0.8", "1"]),
        (Axis(1e-7, 2e-7), ["1e-7", "1.2e-7", "1.4e-7", "1.6e-7", "1.8e-7", "2e-7"]),
        (
            Axis(100_000, 100_003),
            ["1e5", "1.000005e5", "1.00001e5", "1.000015e5", "1.00002e5", "1.000025e5", "1.00003e5"],
        ),
        (Axis(-1e30, 5, 1.0), ["-1e30", "-1e22", "-1e14", "-1e6", "0"]),
        (Axis(-300, 40, 10.0), ["-100", "-10", "0", "10"]),
        (Axis(4, 6, 1.0), []),
    ],
)
def test_ticks_are_round_and_can_be_told_apart(axis: Axis, labels: list[str]) -> None:
    ticks = axis.ticks()
    assert list(ticks.values()) == labels
    assert all(axis.low <= tick <= axis.high for tick in ticks)


def test_a_linear_axis_keeps_distances() -> None:
    axis = Axis(10, 30)
    assert [axis.share(value) for value in (10, 15, 30, math.inf, -1e300)] == [0, 0.25, 1, 2, -1]


def test_a_symlog_axis_gives_each_decade_the_same_room() -> None:
    axis = Axis(-100, 100, 1.0)
    assert [round(axis.share(value) * 6, 6) for value in (-100, -10, -1, 0, 0.5, 1, 10, 100)] == [
        0,
        1,
        2,
        3,
        3.5,
        4,
        5,
        6,
    ]


def test_an_axis_without_extent_has_a_place() -> None:
    assert Axis(1e30, 1e30, 1.0).share(1e30) == 0
