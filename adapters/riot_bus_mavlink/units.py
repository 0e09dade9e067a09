"""Values worth trying by unit: angles that wrap, shares above the whole, temperatures below absolute zero."""

from __future__ import annotations

import math
import re

_Values = tuple[tuple[float, str], ...]

_BASES: dict[str, _Values] = {
    "deg": (
        (0, "0 deg"),
        (90, "90 deg"),
        (-90, "-90 deg"),
        (90.5, "beyond a pole"),
        (-90.5, "beyond a pole"),
        (180, "180 deg"),
        (-180, "-180 deg"),
        (180.5, "beyond 180 deg"),
        (-180.5, "beyond -180 deg"),
        (360, "a full turn"),
        (360.5, "more than a full turn"),
        (-360, "a full turn backwards"),
    ),
    "rad": (
        (0, "0 rad"),
        (math.pi / 2, "90 deg"),
        (-math.pi / 2, "-90 deg"),
        (math.pi, "180 deg"),
        (-math.pi, "-180 deg"),
        (math.pi + 0.01, "beyond 180 deg"),
        (2 * math.pi, "a full turn"),
        (1000, "degrees in place of radians"),
    ),
    "%": ((0, "nothing"), (100, "all"), (101, "more than all"), (-1, "less than nothing")),
    "m": (
        (0, "zero"),
        (-1, "negative"),
        (-500, "below any land"),
        (9000, "above any land"),
        (100_000, "in space"),
        (40_075_000, "once around the earth"),
    ),
    "m/s": ((0, "standing"), (-1, "backwards"), (343, "the speed of sound"), (299_792_458, "the speed of light")),
    "m/s/s": ((0, "no acceleration"), (-9.80665, "free fall"), (1000, "a crash")),
    "rad/s": ((0, "no turning"), (-1, "turning back"), (1000, "faster than any body turns")),
    "deg/s": ((0, "no turning"), (-1, "turning back"), (100_000, "faster than any body turns")),
    "s": ((0, "no time"), (-1, "negative"), (86_400, "a day"), (2_147_483_648, "beyond 31 bits of seconds")),
    "V": ((0, "no voltage"), (-1, "negative"), (1000, "high voltage")),
    "A": ((0, "no current"), (-1, "negative"), (1000, "a short circuit")),
    "Ah": ((0, "empty"), (-1, "negative")),
    "degC": ((0, "freezing"), (-273.15, "absolute zero"), (-274, "below absolute zero"), (1000, "burning")),
    "Pa": ((0, "vacuum"), (-1, "negative"), (101_325, "sea level"), (1e7, "deep under water")),
    "Hz": ((0, "never"), (-1, "negative"), (1e6, "faster than any link")),
    "rpm": ((0, "standing"), (-1, "backwards"), (1e6, "faster than any motor")),
    "byte": (
        (0, "nothing"),
        (1, "one byte"),
        (-1, "negative"),
        (256, "more than a payload"),
        (65_536, "beyond 16 bits"),
    ),
    "g": ((0, "nothing"), (-1, "negative")),
    "gauss": ((0, "no field"), (1000, "beside a magnet")),
}

_NAMES = {
    "degE7": ("deg", 1e7),
    "degE5": ("deg", 1e5),
    "deg/2": ("deg", 0.5),
    "G": ("m/s/s", 1 / 9.80665),
    "mG": ("m/s/s", 1000 / 9.80665),
    "mgauss": ("gauss", 1000),
    "mbar": ("Pa", 0.01),
    "bytes": ("byte", 1),
    "KiB": ("byte", 1 / 1024),
    "MiB": ("byte", 1 / 1024**2),
    "m/s*5": ("m/s", 5),
}
"""Units that are not a prefix and a base: the base unit, and how many of the unit make one of it."""

# how many of the prefixed unit make one of the unit
_PREFIXES = {"n": 1e9, "u": 1e6, "m": 1e3, "c": 1e2, "d": 10, "da": 0.1, "h": 1e-2, "k": 1e-3, "M": 1e-6}
_PREFIXED = re.compile(r"(da|[numcdhkM])(.+)")


def values_of_unit(unit: str) -> list[tuple[float, str]]:
    """Return values in a unit as dialects write it (`degE7`, `cdeg`, `mm/s`, `d%`), and why they are worth trying.

    >>> values_of_unit("d%")
    [(0.0, 'nothing'), (1000.0, 'all'), (1010.0, 'more than all'), (-10.0, 'less than nothing')]
    """
    base, scale = _NAMES.get(unit, (unit, 1))
    if base not in _BASES and (match := _PREFIXED.fullmatch(unit)):
        base, scale = match[2], _PREFIXES[match[1]]
    return [(value * scale, reason) for value, reason in _BASES.get(base, ())]
