"""How far a point is from the boundary `feature = value`, per kind of feature, in units of the variables' spreads."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from riot_bus.generalize.features import Array

__all__ = ["boundary_distance"]


def boundary_distance(kind: str, points: Sequence[Array], units: Sequence[float], value: float) -> Array:
    """Return an upper bound of the distance to the boundary, exact for moves along one axis.

    Args:
        kind: Kind of a numeric feature (`riot_bus.generalize.features`).
        points: One float64 array per argument.
        units: Nominal spread of each argument.
        value: The constant the feature is compared with.

    Returns:
        Non-negative array, NaN or infinite where the point or the boundary is at infinity.
    """
    with np.errstate(all="ignore"):
        if len(points) == 1:
            place = np.abs(points[0]) if kind == "abs" else points[0]
            return np.asarray(np.abs(place - value) / units[0])
        x, y = points
        if kind == "mul":
            return _product(x / units[0], y / units[1], value / units[0] / units[1])
        if kind == "div":
            return _quotient(x, y, units, value)
        if kind == "hypot":
            return np.asarray(np.abs(np.hypot(x, y) - value) / max(units))
        if kind in ("maxabs", "minabs"):
            choose = np.maximum if kind == "maxabs" else np.minimum
            return np.asarray(np.abs(choose(np.abs(x), np.abs(y)) - value) / max(units))
        if kind.startswith("wrap"):
            total = np.mod(x + y, 2.0 ** int(kind[4:]))
            return np.asarray(np.abs(total - value) / max(units))
        total = x - y if kind == "sub" else x + y
        return np.asarray(np.abs(total - value) / max(units))


def _product(u: Array, v: Array, value: float) -> Array:
    """Distance to the hyperbola u * v = value: along an axis or to the nearer vertex; to the axes when value is 0."""
    if value == 0:
        return np.asarray(np.minimum(np.abs(u), np.abs(v)))
    root = math.sqrt(abs(value))
    other = math.copysign(root, value)
    vertex = np.minimum(np.hypot(u - root, v - other), np.hypot(u + root, v + other))
    return np.asarray(np.fmin(np.fmin(np.abs(value / v - u), np.abs(value / u - v)), vertex))


def _quotient(x: Array, y: Array, units: Sequence[float], value: float) -> Array:
    """Distance to x / y = value: in x, in y, or to y = 0, where the quotient jumps through infinity."""
    moves = np.fmin(np.abs(value * y - x) / units[0], np.abs(y) / units[1])
    return np.asarray(moves if value == 0 else np.fmin(moves, np.abs(x / value - y) / units[1]))
