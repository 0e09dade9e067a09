from __future__ import annotations

import math

import pytest

from riot_bus_mavlink.units import values_of_unit


@pytest.mark.parametrize(
    ("unit", "reason", "value"),
    [
        ("deg", "beyond a pole", 90.5),
        ("cdeg", "180 deg", 18_000),
        ("degE7", "180 deg", 1_800_000_000),
        ("deg/2", "180 deg", 90),
        ("rad", "180 deg", math.pi),
        ("mrad", "180 deg", 1000 * math.pi),
        ("d%", "all", 1000),
        ("c%", "all", 10_000),
        ("mm", "in space", 1e8),
        ("dam", "in space", 10_000),
        ("m", "in space", 100_000),
        ("km/s", "the speed of sound", 0.343),
        ("m/s*5", "the speed of sound", 5 * 343),
        ("mG", "free fall", -1000),
        ("us", "a day", 86_400e6),
        ("mbar", "sea level", 1013.25),
        ("hPa", "sea level", 1013.25),
        ("cdegC", "absolute zero", -27_315),
        ("KiB", "beyond 16 bits", 64),
        ("MHz", "faster than any link", 1),
    ],
)
def test_the_same_thing_is_tried_in_each_unit(unit: str, reason: str, value: float) -> None:
    values = [value for value, why in values_of_unit(unit) if why == reason]
    assert any(each == pytest.approx(value) for each in values), values


@pytest.mark.parametrize("unit", ["", "parsec", "k", "da", "mm/parsec", "md%"])
def test_nothing_is_known_of_other_units(unit: str) -> None:
    assert values_of_unit(unit) == []
