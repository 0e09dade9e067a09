"""Computes the distance from the boundary `feature = value`, by kind of feature, in units of the variables' spreads."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from riot_bus.generalize.expressions import Array
from riot_bus.generalize.features import Feature

WRAPS = re.compile("(wrap|signed|cast)(sub|mul)?(?=[0-9])")
"""Beginning of the kinds of features that wrap around; the number of bits follows."""


def boundary_distance(
    feature: Feature, points: Sequence[Array], values: Array, units: Sequence[float], value: float
) -> Array:
    """Return an upper bound of the distance to the boundary, exact for moves along one axis.

    `points` has one float64 array per argument (none for features of texts), `values` the feature itself.

    Returns:
        Non-negative array, NaN or infinite where the point or the boundary is at infinity.
    """
    kind = feature.kind
    with np.errstate(all="ignore"):
        gap = np.abs(values.astype(np.float64) - value)
        if kind == "mul":
            x, y = points
            return _product(x / units[0], y / units[1], value / units[0] / units[1])
        if kind == "div":
            return _quotient(points[0], points[1], units, value)
        if kind == "mul3":
            x, y, z = (np.abs(point) for point in points)
            slopes = (y * z * units[0], x * z * units[1], x * y * units[2])
            return np.asarray(np.min([gap / slope for slope in slopes], axis=0))
        if kind == "mulsub":
            x, y, _ = (np.abs(point) for point in points)
            return np.asarray(np.fmin(np.fmin(gap / (y * units[0]), gap / (x * units[1])), gap / units[2]))
        if isinstance(feature.constant, tuple):
            return np.asarray(
                gap / max(abs(weight) * unit for weight, unit in zip(feature.constant, units, strict=True))
            )
        if WRAPS.match(kind):
            # The numbers lie on a circle: the jump is a boundary, too.
            size = _circle(feature)
            above = np.mod(values.astype(np.float64) + (0.0 if kind.startswith("wrap") else size / 2), size)
            return np.asarray(np.minimum(gap, np.minimum(above + 1, size - above)) / max(units))
        return np.asarray(gap / max(units))


def arc_distance(feature: Feature, values: Array, units: Sequence[float], low: float, high: float) -> Array:
    """Return the distance of points outside an arc of a circle to its nearer end: the jump does not lead into it."""
    place, size = values.astype(np.float64), _circle(feature)
    return np.asarray(np.minimum(np.mod(low - place, size), np.mod(place - high, size)) / max(units))


def _circle(feature: Feature) -> float:
    """Return how many values a feature has that wraps around."""
    return 2.0 ** int(WRAPS.sub("", feature.kind))


def _product(u: Array, v: Array, value: float) -> Array:
    """Return the distance to u * v = value: along an axis or to the nearer vertex; to the axes when value is 0."""
    if value == 0:
        return np.asarray(np.minimum(np.abs(u), np.abs(v)))
    root = math.sqrt(abs(value))
    other = math.copysign(root, value)
    vertex = np.minimum(np.hypot(u - root, v - other), np.hypot(u + root, v + other))
    return np.asarray(np.fmin(np.fmin(np.abs(value / v - u), np.abs(value / u - v)), vertex))


def _quotient(x: Array, y: Array, units: Sequence[float], value: float) -> Array:
    """Return the distance to x / y = value: in x, in y, or to y = 0, where the quotient jumps through infinity."""
    moves = np.fmin(np.abs(value * y - x) / units[0], np.abs(y) / units[1])
    return np.asarray(moves if value == 0 else np.fmin(moves, np.abs(x / value - y) / units[1]))
