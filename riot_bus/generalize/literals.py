"""Literals: one comparison of a feature with a constant, its truth and its distance from the boundary."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from riot_bus.generalize.features import FLAGS, Array, Feature, numeric
from riot_bus.generalize.margins import boundary_distance
from riot_bus.generalize.numbers import number_text
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.trial import Scalar

__all__ = ["FAR", "OPERATORS", "Literal"]

FAR = 1e18
"""The distance where there is none (NaN, other types) and the bound of all distances."""

NEAR = 1e-300
"""Distance inside of a point on the boundary itself: keeps "negative inside" exact."""

OPERATORS = ("<", "<=", ">", ">=", "==", "!=", "is", "not")


@dataclass(frozen=True, slots=True)
class Literal:
    """`feature operator value`; the operators "is" and "not" belong to flags (isnan, not isfinite), without value.

    Raises:
        ConfigError: If operator, feature and value do not fit together.
    """

    feature: Feature
    operator: str
    value: Scalar | None = None

    def __post_init__(self) -> None:
        flag = self.feature.kind in FLAGS
        if self.operator not in OPERATORS or flag != (self.operator in ("is", "not")):
            raise ConfigError(f"operator {self.operator!r} does not fit the feature {self.feature.text()!r}")
        if flag:
            if self.value is not None:
                raise ConfigError(f"{self.feature.text()!r} is not compared with a value")
            return
        if isinstance(self.value, int | float) and not isinstance(self.value, bool):
            if not math.isfinite(self.value):
                raise ConfigError(f"threshold of {self.feature.text()!r} must be finite, not {self.value!r}")
        elif (
            self.operator not in ("==", "!=")
            or self.feature.kind != "raw"
            or not isinstance(self.value, bool | str | bytes)
        ):
            raise ConfigError(f"{self.feature.text()!r} cannot be compared with {self.value!r}")

    def text(self) -> str:
        """Return it as people write it."""
        if self.operator in ("is", "not"):
            return self.feature.text() if self.operator == "is" else f"not ({self.feature.text()})"
        return f"{self.feature.text()} {self.operator} {self._value_text()}"

    def python(self, variable: str) -> str:
        """Return a Python expression over the dict called `variable`."""
        expression = self.feature.python(variable)
        if self.operator in ("is", "not"):
            return expression if self.operator == "is" else f"not ({expression})"
        if isinstance(self.value, float):
            return f"{expression} {self.operator} {self.value!r}"
        return f"{expression} {self.operator} {self._value_text()}"

    def _value_text(self) -> str:
        if isinstance(self.value, int | float) and not isinstance(self.value, bool):
            return number_text(self.value)
        return '"' + self.value + '"' if isinstance(self.value, str) and self.value.isalnum() else repr(self.value)

    def holds(self, columns: Mapping[str, Array]) -> Array:
        """Return one boolean per row; False where the value has another type or is NaN.

        Args:
            columns: One array of equal length per variable.
        """
        if isinstance(self.value, str | bytes | bool):
            return self._same(self.feature.column(columns))
        values = self.feature.values(columns)
        if values is None:
            return np.zeros(self.feature.column(columns).shape, dtype=bool)
        if self.operator in ("is", "not"):
            return np.asarray(values if self.operator == "is" else ~values)
        assert self.value is not None
        return compare(values, self.operator, self.value)

    def _same(self, column: Array) -> Array:
        kinds = {str: "UO", bytes: "SO", bool: "bO"}[type(self.value)]
        if column.dtype.kind not in kinds:
            return np.zeros(column.shape, dtype=bool)
        rows = column.tolist()
        equal = [type(row) is type(self.value) and row == self.value for row in rows]
        if self.operator == "!=":
            equal = [type(row) is type(self.value) and row != self.value for row in rows]
        return np.array(equal, dtype=bool).reshape(column.shape)

    def distance(self, columns: Mapping[str, Array], scale: Mapping[str, float]) -> Array:
        """Return the distance to the boundary per row, negative exactly where the literal holds.

        It is the smallest move of one variable (or, for products, also of both) that reaches the boundary, in units of
        `scale`; categories and flags, which have no margin, are at 1 or -1.

        Args:
            columns: One array of equal length per variable.
            scale: Nominal spread of each variable; 1 where it is missing or not positive.
        """
        inside = self.holds(columns)
        if isinstance(self.value, str | bytes | bool) or self.operator in ("is", "not"):
            return np.asarray(np.where(inside, -1.0, 1.0))
        arrays = [numeric(self.feature.column(columns, index)) for index in range(len(self.feature.args))]
        if any(array is None for array in arrays):
            return np.full(inside.shape, FAR)
        units = [_unit(scale.get(name, 1.0)) for name in self.feature.args]
        assert self.value is not None
        points = [array.astype(np.float64) for array in arrays if array is not None]
        far = boundary_distance(self.feature.kind, points, units, float(self.value))
        if self.operator in ("==", "!="):
            far = np.where(inside == (self.operator == "=="), 0.5 / max(units), far)
        far = np.clip(np.nan_to_num(far, nan=FAR, posinf=FAR, neginf=FAR), 0.0, FAR)
        return np.asarray(np.where(inside, -np.maximum(far, NEAR), far))


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
