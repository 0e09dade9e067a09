"""Literals: one comparison of a feature with a constant, its truth and its distance from the boundary.

Distances are by kind of feature, in units of the variables' spreads.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from riot_bus.generalize.expressions import Applied, Array, numeric, text
from riot_bus.generalize.features import FLAGS, Feature
from riot_bus.generalize.numbers import number_text
from riot_bus.vocabulary.elements import Quantity, quantity_of
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Scalar
from riot_bus.vocabulary.order import order_of

FAR = 1e18
"""Distance of values that have none (NaN, other types), and the upper bound of all distances."""

NEAR = 1e-300
"""Distance of a point on the boundary itself: keeps "negative inside, positive outside" exact."""

OPERATORS = ("<", "<=", ">", ">=", "==", "!=", "is", "not", "in", "not in")

LARGEST_SET = 16
"""Maximum number of members of a set."""

_SHOWN = 48
"""Texts longer than this are not shown whole."""

_BEYOND = {"max": ">", "min": "<"}
"""Comparison that the largest, or smallest, element meets if any element does; the opposite one means all elements."""

_ODD = {"isnan": "NaN", "nonfinite": "not finite"}

WRAPS = re.compile("(wrap|signed|cast)(sub|mul)?(?=[0-9])")
"""Beginning of the kinds of features that wrap around; the number of bits follows."""

Value = Scalar | tuple[Scalar, ...] | None


@dataclass(frozen=True, slots=True)
class Literal:
    """`feature operator value`; the operators "is" and "not" belong to flags (isnan, not isfinite), without value.

    "in" and "not in" compare one variable with a set: at least two distinct integers, or texts, or bytes.

    Raises:
        ConfigError: If operator, feature and value do not fit together.
    """

    feature: Feature
    operator: str
    value: Value = None

    def __post_init__(self) -> None:
        flag = self.feature.kind in FLAGS
        if self.operator not in OPERATORS or flag != (self.operator in ("is", "not")):
            raise ConfigError(f"operator {self.operator!r} does not fit the feature {self.feature.text()!r}")
        if flag:
            if self.value is not None:
                raise ConfigError(f"{self.feature.text()!r} is not compared with a value")
            return
        if (self.operator in ("in", "not in")) != isinstance(self.value, tuple):
            raise ConfigError(f"{self.feature.text()!r} {self.operator} needs a set, and only that")
        if isinstance(self.value, tuple):
            kinds = {type(member) for member in self.value}
            fits = len(set(self.value)) == len(self.value) and 2 <= len(self.value) <= LARGEST_SET
            if self.feature.kind != "raw" or len(kinds) != 1 or not kinds <= {int, str, bytes} or not fits:
                raise ConfigError(f"{self.feature.text()!r} cannot be compared with the set {self.value!r:.200}")
        elif isinstance(self.value, int | float) and not isinstance(self.value, bool):
            if not math.isfinite(self.value):
                raise ConfigError(f"threshold of {self.feature.text()!r} must be finite, not {self.value!r}")
        elif (
            self.operator not in ("==", "!=")
            or self.feature.kind != "raw"
            or not isinstance(self.value, bool | str | bytes)
        ):
            raise ConfigError(f"{self.feature.text()!r} cannot be compared with {self.value!r}")

    def text(self) -> str:
        """Return the literal as people write it: `i >= w` rather than `i - w >= 0`."""
        if self.operator in ("is", "not"):
            return self.feature.text() if self.operator == "is" else _opposite(self.feature)
        order = order_of(self.feature.args[0]) if isinstance(self.value, bool) else None
        if order is not None:
            held = self.value == (self.operator == "==")
            return str(order) if held else f"not {order}" if order.once else f"{order.second} before {order.first}"
        quantity = quantity_of(self.feature.args[0]) if self.feature.kind == "raw" else None
        if quantity is not None and (self.operator[0] in "<>" or isinstance(self.value, bool)):
            return self._of_elements(quantity)
        node = self.feature.expression
        if self.value == 0 and isinstance(node, Applied) and node.operator == "sub":
            return f"{text(node.args[0])} {self.operator} {text(node.args[1])}"
        return f"{self.feature.text()} {self.operator} {_shown(self.value)}"

    def _of_elements(self, quantity: Quantity) -> str:
        """Return a statement about the largest, smallest or odd elements as one about any or all elements."""
        elements = f"({quantity.topic}{quantity.path})"
        if isinstance(self.value, bool):
            word = "any" if self.value == (self.operator == "==") else "none"
            return f"{word}{elements} is {_ODD[quantity.kind]}"
        word = "any" if self.operator[0] == _BEYOND.get(quantity.kind) else "all"
        return f"{word}{elements} {self.operator} {_shown(self.value)}"

    def holds(self, columns: Mapping[str, Array]) -> Array:
        """Return one boolean per row; False where the value has another type or is NaN."""
        members = self.value if isinstance(self.value, tuple) else (self.value,)
        if isinstance(members[0], str | bytes | bool):
            return _among(self.feature.column(columns), members, wanted=self.operator in ("==", "in"))
        values = self.feature.values(columns)
        if values is None:
            return np.zeros(self.feature.column(columns).shape, dtype=bool)
        if self.operator in ("is", "not"):
            return np.asarray(values == (self.operator == "is"))
        if isinstance(self.value, tuple):
            hits = np.any([compare(values, "==", member) for member in members], axis=0)
            return np.asarray(hits if self.operator == "in" else ~hits & (values == values))
        return compare(values, self.operator, self.value)

    def distance(self, columns: Mapping[str, Array], scale: Mapping[str, float]) -> Array:
        """Return the distance to the boundary per row, negative exactly where the literal holds, else positive.

        It is the smallest move of one variable (or, for products, also of both) that reaches the boundary, in units of
        `scale`; categories and flags, which have no margin, are at 1 or -1.
        """
        inside = self.holds(columns)
        members = self.value if isinstance(self.value, tuple) else (self.value,)
        values = None if isinstance(members[0], str | bytes | bool | None) else self.feature.values(columns)
        if values is None:
            known = self.value is None or isinstance(members[0], str | bytes | bool)
            return np.asarray(np.where(inside, -1.0, 1.0 if known else FAR))
        units = [_unit(scale.get(name, 1.0)) for name in self.feature.args]
        if self.operator in ("==", "!=", "in", "not in"):
            # To a member along one variable; a member itself is half a step from what is beside it.
            place = values.astype(np.float64)
            far = np.min([np.abs(place - float(member)) for member in members if member is not None], axis=0)
            far = np.where(inside == (self.operator in ("==", "in")), 0.5, far) / max(units)
        else:
            arrays = [numeric(self.feature.column(columns, index)) for index in range(len(self.feature.args))]
            points = [array.astype(np.float64) for array in arrays if array is not None]
            assert isinstance(self.value, int | float)
            far = boundary_distance(self.feature, points, values, units, float(self.value))
        far = np.clip(np.nan_to_num(far, nan=FAR, posinf=FAR, neginf=FAR), 0.0, FAR)
        far = np.maximum(far, NEAR)
        return np.asarray(np.where(inside, -far, far))


def arc_distances(term: Sequence[Literal], columns: Mapping[str, Array], scale: Mapping[str, float]) -> Iterator[Array]:
    """Yield distances to each range that a term demands of a feature that wraps around; far below 0 within it.

    A point near the jump is near to one of the two limits alone, but not to the range between them.
    """
    for lower in term:
        values = lower.feature.values(columns) if WRAPS.match(lower.feature.kind) else None
        for upper in term:
            if values is None or (lower.operator[0], upper.operator[0]) != (">", "<") or upper.feature != lower.feature:
                continue
            low, high = lower.value, upper.value
            assert isinstance(low, int | float)
            assert isinstance(high, int | float)
            if low <= high:
                units = [_unit(scale.get(name, 1.0)) for name in lower.feature.args]
                far = np.clip(_arc_distance(lower.feature, values, units, low, high), NEAR, FAR)
                yield np.where(lower.holds(columns) & upper.holds(columns), -FAR, np.nan_to_num(far, nan=FAR))


def _opposite(feature: Feature) -> str:
    """Return the text of a negated flag, without a double "not"."""
    node = feature.expression
    return text(node.args[0]) if isinstance(node, Applied) and node.operator == "not" else f"not {feature.text()}"


def _shown(value: Value) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(_shown(member) for member in value)})"
    if isinstance(value, int | float) and not isinstance(value, bool):
        return number_text(value)
    if isinstance(value, str | bytes) and len(value) > _SHOWN:
        return f"{value[:16]!r}... (length {len(value)})"
    return '"' + value + '"' if isinstance(value, str) and (not value or value.isalnum()) else repr(value)


def _among(column: Array, members: tuple[Value, ...], *, wanted: bool) -> Array:
    """Return where a column has one of the members, or another value of their type."""
    type_ = type(members[0])
    if column.dtype.kind not in {str: "UO", bytes: "SO", bool: "bO"}[type_]:
        return np.zeros(column.shape, dtype=bool)
    same = [type(row) is type_ and (row in members) == wanted for row in column.ravel().tolist()]
    return np.array(same, dtype=bool).reshape(column.shape)


def _unit(spread: float) -> float:
    return float(spread) if math.isfinite(spread) and spread > 0 else 1.0


def compare(values: Array, operator: str, value: Any) -> Array:
    """Compare without rounding: integer columns with integers, float columns with floats."""
    if values.dtype.kind == "f":
        value = float(value)
    elif isinstance(value, float):
        if value.is_integer():
            value = int(value)
        elif operator in ("==", "!="):
            return np.full(values.shape, operator == "!=")
        else:
            value = math.floor(value)
            operator = {">=": ">", "<": "<="}.get(operator, operator)
    if values.dtype.kind == "i" and not -(2**63) <= value < 2**63:
        values = values.astype(object)
    with np.errstate(all="ignore"):
        result = {
            "<": lambda: values < value,
            "<=": lambda: values <= value,
            ">": lambda: values > value,
            ">=": lambda: values >= value,
            "==": lambda: values == value,
            "!=": lambda: (values != value) & (values == values),
        }[operator]()
    return np.asarray(result).astype(bool)


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


def _arc_distance(feature: Feature, values: Array, units: Sequence[float], low: float, high: float) -> Array:
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
