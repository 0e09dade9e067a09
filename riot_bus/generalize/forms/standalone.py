"""Arithmetic of rules, and the search for the nearest values for which one does not hold.

Sanitising functions in Python contain a copy of this file, so it needs the standard library alone.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any

INTEGERS = {
    f"{sign}int{bits}": (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
FLOATS = {"float32": (24, -149), "float64": (53, -1074)}
STEPS = (0, 1, -1, 2, -2, 4, -4)
"""So many units in the last place from a root its neighbours are tried: what rounding can be off, and a little more."""

Term = Callable[..., bool]
Root = tuple[int, Callable[..., Any], float]
"""Which value, where it makes a part of the rule change (the others as they are), and the threshold of that part."""


def div(a: float, b: float) -> float:
    """Divide as IEEE 754 does."""
    a, b = float(a), float(b)
    if b:
        return a / b
    if not a or a != a or b != b:
        return math.nan
    return math.copysign(math.inf, a) * math.copysign(1.0, b)


def quotient(a: int | float, b: int | float) -> int | float:
    """Divide; integers give the whole number below. NaN if there is no such number."""
    if not b:
        return math.nan
    return a // b if isinstance(a, int) and isinstance(b, int) else a / b


def leg(a: float, b: float) -> float:
    """Return the other leg of a triangle with the hypotenuse a and the leg b; NaN if there is none."""
    a, b = float(a), float(b)
    return math.sqrt((a - b) * (a + b)) if abs(b) <= abs(a) < math.inf else math.nan


def larger(a: int | float, b: int | float) -> int | float:
    """Return the larger number, a float if one is; NaN if one is."""
    if isinstance(a, float) or isinstance(b, float):
        a, b = float(a), float(b)
    return math.nan if a != a or b != b else max(a, b)


def smaller(a: int | float, b: int | float) -> int | float:
    """Return the smaller number, a float if one is; NaN if one is."""
    return -larger(-a, -b)


def nearest(
    values: Sequence[Any], terms: Sequence[Term], roots: Sequence[Root], kinds: Sequence[str], units: Sequence[float]
) -> list[Any] | None:
    """Search for values near the given ones for which every term is false; None if none are found.

    Each step changes one value so that fewer terms are true. It prefers a change after which none is true, then the
    smallest one.

    Args:
        values: Values of the rule's variables, in their order.
        terms: Functions of all values; the rule holds if one of them is true.
        roots: Places where parts of the rule change between true and false.
        kinds: Types of the values, such as `float64`.
        units: Units in which the changes of the values are measured, such as their nominal spreads; positive.
    """
    now = list(values)
    for _ in range(len(terms) + 1):
        held = sum(term(*now) for term in terms)
        if not held:
            return now
        best: tuple[bool, float, list[Any]] | None = None
        for place, value in candidates(now, roots, kinds):
            changed = [*now[:place], value, *now[place + 1 :]]
            left = sum(term(*changed) for term in terms)
            far = abs(value - now[place]) / units[place]
            if left < held and (best is None or (left > 0, far) < best[:2]):
                best = left > 0, far, changed
        if best is None:
            return None
        now = best[2]
    return None


def candidates(values: Sequence[Any], roots: Sequence[Root], kinds: Sequence[str]) -> Iterator[tuple[int, Any]]:
    """Yield single values that could make a part of the rule false."""
    sizes = [abs(float(each)) for each in values if isinstance(each, int | float)]
    for place, where, threshold in roots:
        found = where(*values)
        if math.isfinite(found):
            largest = max(size for size in (*sizes, abs(float(threshold)), 0.0) if math.isfinite(size))
            for value in near(found, kinds[place], largest):
                yield place, value


def near(root: float, kind: str, largest: float) -> Iterator[Any]:
    """Yield values of a type at a root and beside it."""
    if kind in INTEGERS:
        low, high = INTEGERS[kind]
        yield from (whole for step in STEPS if low <= (whole := math.floor(root) + step) <= high)
        return
    bits, lowest = FLOATS[kind]
    # Rounding of a sum may be off by the last place of its largest part, of a quotient by its own.
    for size in (root, largest):
        unit = math.ldexp(1.0, max(math.frexp(size)[1] - bits, lowest))
        for step in STEPS:
            value = float(root + step * unit)
            if bits == 24:
                value = single(value)
            if math.isfinite(value):
                yield value


def single(value: float) -> float:
    """Round to single precision; infinite if it is too large."""
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.inf
