from __future__ import annotations

import math
import random
import struct

import pytest

from riot_bus.generalize.numbers import between, logarithmic, number_bits, number_text, simplest, step


def test_numbers_that_people_would_choose_are_short() -> None:
    assert number_bits(0) < number_bits(1) == number_bits(7) < number_bits(12) < number_bits(123)
    for plain, odd in ((10**6, 999_983), (2**31, 2**31 + 5), (2**31 - 1, 2**31 - 3), (0.5, 0.4871), (1e-9, 1.37e-9)):
        assert number_bits(plain) < number_bits(odd)
    assert number_bits(5.0) == number_bits(5) < number_bits(-5)
    assert number_bits(math.inf) < number_bits(-math.inf) < number_bits(4711)


@pytest.mark.parametrize("value", [0, -3, 2**70, 0.1, 5e-324, 1.7976931348623157e308, 123456789.5, -0.25])
def test_a_spelling_is_read_back(value: float) -> None:
    assert float(number_text(value)) == value
    assert number_text(float(7)) == "7"
    assert number_text(1e12) == "1000000000000.0"


@pytest.mark.parametrize("value", [0, 5, -5, 0.0, 1.0, -1.0, 5e-324])
def test_steps_go_to_the_next_number(value: float) -> None:
    for way in (1, -1):
        assert (step(value, way) - value) * way > 0
        assert step(step(value, way), -way) == value
        assert between(*sorted((value, step(value, way)))) is None


def halvings(low: float, high: float, wanted: float) -> int:
    """Return how many questions a search for the last number up to `wanted` takes."""
    for count in range(200):
        middle = between(low, high)
        if middle is None:
            assert low <= wanted < high
            return count
        assert low < middle < high
        assert type(middle) is type(low)
        low, high = (middle, high) if middle <= wanted else (low, middle)
    raise AssertionError("it does not end")


def test_any_threshold_is_found_in_few_steps() -> None:
    draw = random.Random(0)
    for _ in range(200):
        (wanted,) = struct.unpack("<d", draw.randbytes(8))
        if math.isfinite(wanted):
            assert halvings(-math.inf, math.inf, wanted) <= 64
        whole = draw.randrange(2 ** draw.randrange(1, 63)) * draw.choice((-1, 1))
        assert halvings(-(2**63), 2**63, whole) <= 80


def test_the_middle_is_one_of_magnitudes() -> None:
    assert between(0, 10**6) == pytest.approx(1000, rel=0.01)
    assert between(-(10**6), 0) == pytest.approx(-1000, rel=0.01)
    assert between(-(10**6), 10**6) == 0
    assert between(100, 150) == 125


def test_the_logarithmic_scale_is_symmetric() -> None:
    assert logarithmic(0) == 0
    assert logarithmic(7) == 3
    assert logarithmic(-7) == -3


@pytest.mark.parametrize(
    ("low", "high", "found"),
    [
        (-3, 5, 0),
        (61.7, 170.2, 100.0),
        (99.3, 104.2, 100.0),
        (-104.2, -99.3, -100.0),
        (2**31 - 3, 2**31 + 2, 2**31),
        (2**31 - 3, 2**31 - 1, 2**31 - 1),
        (0.0912, 0.123, 0.1),
        (3.1411, 3.1429, 3.142),
        (1.5e-310, 3.5e-310, 2e-310),
        (987654321, 987654321, 987654321),
        (1e300, math.inf, 1e300),
        (math.inf, math.inf, math.inf),
    ],
)
def test_the_simplest_number_of_an_interval(low: float, high: float, found: float) -> None:
    assert simplest(low, high) == found
    assert type(simplest(low, high)) is type(found)


def test_the_simplest_number_is_in_the_interval_and_no_end_is_simpler() -> None:
    draw = random.Random(1)
    for _ in range(300):
        low, high = sorted(draw.choice((-1, 1)) * 10 ** draw.uniform(-12, 12) for _ in range(2))
        whole = [round(low), round(high)]
        for first, last in ((low, high), whole):
            found = simplest(first, last)
            assert first <= found <= last
            assert number_bits(found) <= min(number_bits(first), number_bits(last)) + 1e-6
