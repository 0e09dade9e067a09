"""Measures how simple a number is, and finds the simplest in an interval: learnt thresholds read 0, 1e6 or 2^31."""

from __future__ import annotations

import math
import struct
import sys
from decimal import Decimal
from functools import lru_cache

Number = int | float

_DIGIT = math.log2(10)


def number_bits(value: Number) -> float:
    """Return a description length in bits: few digits, powers of ten and powers of two are short."""
    if value == 0:
        return 1.0
    sign = 0.5 if value < 0 else 0.0
    if not math.isfinite(value):
        return 4.0 + sign
    shortest = 64.0
    if value == int(value):
        whole = abs(int(value))
        for power, extra in ((whole, 3.5), (whole + 1, 4.5)):
            if power & (power - 1) == 0:
                shortest = min(shortest, extra + math.log2(power.bit_length()))
    _, digits, exponent = Decimal(repr(value)).as_tuple()
    text = "".join(map(str, digits)).lstrip("0")
    short = text.rstrip("0")
    scale = int(exponent) + len(text) - len(short)
    shortest = min(shortest, _DIGIT * len(short) + 0.7 * math.log2(1 + abs(scale)) + (1.0 if scale < 0 else 0.0))
    return shortest + sign + 1.0


def number_text(value: Number) -> str:
    """Return a short, exact spelling that Python reads back."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e9:
        return str(int(value))
    return str(value)


def _bits_of(value: float) -> int:
    raw: int = struct.unpack("<q", struct.pack("<d", value))[0]
    return raw if raw >= 0 else -(raw & 0x7FFFFFFFFFFFFFFF)


def _float_of(bits: int) -> float:
    value: float = struct.unpack("<d", struct.pack("<Q", bits if bits >= 0 else -bits | 1 << 63))[0]
    return value


def step(value: Number, direction: int) -> Number:
    """Return the next representable number above (1) or below (-1)."""
    if isinstance(value, int):
        return value + direction
    return math.nextafter(value, math.inf if direction > 0 else -math.inf)


def between(low: Number, high: Number) -> Number | None:
    """Return the middle of two numbers on a logarithmic scale, or None when nothing lies strictly between them.

    Integers use sign * log2(1 + |v|), floats the order of their bits, so that 64 steps bound any threshold exactly.
    """
    if isinstance(low, int) and isinstance(high, int):
        if high - low < 2:
            return None
        if high - low < 8 or (low > 0 and high < 2 * low) or (high < 0 and low > 2 * high):
            return (low + high) // 2
        middle = (logarithmic(low) + logarithmic(high)) / 2
        value = round(math.copysign(2 ** abs(middle) - 1, middle))
        return min(max(value, low + 1), high - 1)
    first, last = _bits_of(float(low)), _bits_of(float(high))
    return None if last - first < 2 else _float_of((first + last) // 2)


def logarithmic(value: Number) -> float:
    """Return the place of a number on a logarithmic scale that is 0 at 0 and symmetric."""
    return math.copysign(math.log2(1 + abs(value)), value)


@lru_cache(maxsize=65536)
def _simplest(low: Number, high: Number, integer: bool) -> Number:  # noqa: FBT001 - keeps the cache keys of 1 and 1.0 apart
    if low <= 0 <= high:
        return 0 if integer else 0.0
    if low == high:  # may be infinite
        return low
    if high < 0:
        return -_simplest(-high, -low, integer)
    high = top = high if integer else min(high, sys.float_info.max)
    options: list[Number] = [low, high]
    exponent = len(str(int(top))) - 1 if integer else math.floor(math.log10(top))
    for digits in range(1, 18):
        power = exponent - digits + 1  # of integers at least 0: with 0, all in the interval are options
        unit = 10**power if integer else float(f"1e{max(power, -320)}")
        first = -(-low // unit)
        count = 0
        while count < 10 and (first + count) * unit <= high * (1 + 1e-15 if not integer else 1):
            whole = int(first) + count
            option: Number = whole * 10**power if integer else float(f"{whole}e{power}")
            if low <= option <= high:
                options.append(option)
            count += 1
        if len(options) > 2:
            break
    lowest = math.ceil(math.log10(low)) if low >= 1e-300 else -300
    powers = [power for power in range(lowest, exponent + 1) if power >= 0 or not integer]
    options.extend(10**power if integer else float(f"1e{power}") for power in powers)
    start = math.floor(math.log2(low)) if low >= 1e-300 else 0
    for power in range(max(start, 0), min(start + 2, 1023)):
        options.extend(2**power - lower if integer else float(2**power - lower) for lower in (0, 1))
    if high < 2**1000:
        last = math.floor(math.log2(high))
        options.extend(2**last - lower if integer else float(2**last - lower) for lower in (0, 1) if last >= 0)
    inside = [option for option in options if low <= option <= high]
    middle = (logarithmic(low) + logarithmic(top)) / 2
    return min(inside, key=lambda option: (round(number_bits(option), 6), abs(logarithmic(option) - middle)))


def simplest(low: Number, high: Number) -> Number:
    """Return the simplest number in the closed interval; an integer if both ends are."""
    return _simplest(low, high, isinstance(low, int) and isinstance(high, int))
