"""Derived features: the quantities that the literals of a rule compare (facts: rules need x * y, not boxes)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from riot_bus.vocabulary.errors import ConfigError, did_you_mean

__all__ = ["FEATURE_KINDS", "FLAGS", "Array", "Feature", "features_of", "numeric"]

Array = npt.NDArray[Any]

FEATURE_KINDS: Mapping[str, tuple[int, float, str, str]] = {
    # kind: (number of arguments, cost in bits, text, Python expression)
    "raw": (1, 1.0, "{0}", "{0}"),
    "abs": (1, 3.0, "abs({0})", "abs({0})"),
    "mul": (2, 4.0, "{0} * {1}", "{0} * {1}"),
    "sub": (2, 4.0, "{0} - {1}", "{0} - {1}"),
    "add": (2, 4.5, "{0} + {1}", "{0} + {1}"),
    "div": (2, 5.0, "{0} / {1}", "_div({0}, {1})"),
    "hypot": (2, 6.0, "hypot({0}, {1})", "math.hypot({0}, {1})"),
    "maxabs": (2, 6.0, "max(abs({0}), abs({1}))", "max(abs({0}), abs({1}))"),
    "minabs": (2, 6.5, "min(abs({0}), abs({1}))", "min(abs({0}), abs({1}))"),
    "wrap8": (2, 7.0, "({0} + {1}) % 2**8", "({0} + {1}) % 2**8"),
    "wrap16": (2, 7.0, "({0} + {1}) % 2**16", "({0} + {1}) % 2**16"),
    "wrap32": (2, 7.0, "({0} + {1}) % 2**32", "({0} + {1}) % 2**32"),
    "wrap64": (2, 7.0, "({0} + {1}) % 2**64", "({0} + {1}) % 2**64"),
    "nan": (1, 3.0, "isnan({0})", "math.isnan({0})"),
    "nonfinite": (1, 3.5, "not isfinite({0})", "not math.isfinite({0})"),
}

FLAGS = frozenset({"nan", "nonfinite"})
"""Kinds whose values are booleans."""


def numeric(column: Array) -> Array | None:
    """Return a column as int64, exact Python integers (object) or float64; None when it does not hold numbers.

    Booleans count as 0 and 1.
    """
    kind = column.dtype.kind
    if kind in "bi":
        return column.astype(np.int64)
    if kind == "u":
        wide = column.dtype.itemsize == 8 and column.size and int(column.max()) >= 2**63
        return column.astype(object) if wide else column.astype(np.int64)
    if kind == "f":
        return column.astype(np.float64)
    if kind != "O":
        return None
    values = column.tolist()
    if not all(isinstance(value, bool | int | float) for value in values):
        return None
    if any(isinstance(value, float) for value in values):
        return np.array([float(value) for value in values], dtype=np.float64)
    if all(-(2**63) <= value < 2**63 for value in values):
        return np.array(values, dtype=np.int64)
    return np.array([int(value) for value in values], dtype=object)


def _largest(array: Array) -> int:
    return max(abs(int(array.max())), abs(int(array.min()))) if array.size else 0


def _exact(left: Array, right: Array, operate: Callable[[Any, Any], Any], bound: Callable[[int, int], int]) -> Array:
    """Apply an operator without overflow: int64 where the result fits, Python integers where not, else float64."""
    if left.dtype.kind == "f" or right.dtype.kind == "f":
        with np.errstate(all="ignore"):
            result: Array = operate(left.astype(np.float64), right.astype(np.float64))
        return result
    if bound(_largest(left), _largest(right)) < 2**63:
        return np.asarray(operate(left.astype(np.int64), right.astype(np.int64)))
    return np.asarray(operate(left.astype(object), right.astype(object)), dtype=object)


def _absolute(array: Array) -> Array:
    if array.dtype.kind == "i" and array.size and int(array.min()) == -(2**63):
        array = array.astype(object)
    return np.asarray(np.abs(array))


@dataclass(frozen=True, slots=True, order=True)
class Feature:
    """One derived quantity of one or two variables.

    Args:
        kind: One of `FEATURE_KINDS`.
        args: Names of the variables.

    Raises:
        ConfigError: If the kind is unknown or the number of variables is wrong.
    """

    kind: str
    args: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.kind not in FEATURE_KINDS:
            raise ConfigError(f"unknown feature {self.kind!r}", hint=did_you_mean(self.kind, FEATURE_KINDS))
        if len(self.args) != FEATURE_KINDS[self.kind][0]:
            raise ConfigError(f"feature {self.kind!r} takes {FEATURE_KINDS[self.kind][0]} variables, not {self.args!r}")

    @property
    def cost(self) -> float:
        """Description length in bits without the choice of variables."""
        return FEATURE_KINDS[self.kind][1]

    def text(self) -> str:
        """Return it as people write it."""
        return FEATURE_KINDS[self.kind][2].format(*self.args)

    def python(self, variable: str) -> str:
        """Return a Python expression over the dict called `variable`."""
        return FEATURE_KINDS[self.kind][3].format(*(f"{variable}[{name!r}]" for name in self.args))

    def column(self, columns: Mapping[str, Array], index: int = 0) -> Array:
        """Return the raw column of one argument.

        Raises:
            ConfigError: If there is no such column.
        """
        name = self.args[index]
        if name not in columns:
            raise ConfigError(
                f"the rule needs {name!r}, which is not among the columns", hint=did_you_mean(name, columns)
            )
        return np.asarray(columns[name])

    def values(self, columns: Mapping[str, Array]) -> Array | None:
        """Return the feature of each row, exact for integers; None when a column does not hold numbers.

        Args:
            columns: One array of equal length per variable.

        Returns:
            int64, object (exact Python integers beyond int64) or float64; bool for the kinds in `FLAGS`.
        """
        arrays = [numeric(self.column(columns, index)) for index in range(len(self.args))]
        first = arrays[0]
        if first is None:
            return None
        if len(arrays) == 1:
            return _unary(self.kind, first)
        second = arrays[1]
        return None if second is None else _binary(self.kind, first, second)


def _unary(kind: str, array: Array) -> Array:
    if kind == "abs":
        return _absolute(array)
    if kind in FLAGS:
        if array.dtype.kind != "f":
            return np.zeros(array.shape, dtype=bool)
        return np.asarray(np.isnan(array) if kind == "nan" else ~np.isfinite(array))
    return array


def _binary(kind: str, left: Array, right: Array) -> Array:
    if kind == "mul":
        return _exact(left, right, lambda a, b: a * b, lambda a, b: a * b)
    if kind == "add":
        return _exact(left, right, lambda a, b: a + b, lambda a, b: a + b)
    if kind == "sub":
        return _exact(left, right, lambda a, b: a - b, lambda a, b: a + b)
    if kind.startswith("wrap"):
        modulus = 2 ** int(kind[4:])
        return _exact(left, right, lambda a, b: (a + b) % modulus, lambda a, b: a + b + modulus)
    with np.errstate(all="ignore"):
        if kind == "div":
            return np.asarray(left.astype(np.float64) / right.astype(np.float64))
        if kind == "hypot":
            return np.asarray(np.hypot(left.astype(np.float64), right.astype(np.float64)))
    if "f" in (left.dtype.kind, right.dtype.kind):
        left, right = left.astype(np.float64), right.astype(np.float64)
    choose = np.maximum if kind == "maxabs" else np.minimum
    return np.asarray(choose(_absolute(left), _absolute(right)))


def features_of(types: Mapping[str, str]) -> list[Feature]:
    """Return the features worth trying for variables of these types, cheapest first.

    Args:
        types: Name and type (bool, int8 .. uint64, float32, float64, string, bytes) of each variable.
    """
    numbers = [name for name, type_ in types.items() if type_.startswith(("int", "uint", "float"))]
    found = [Feature("raw", (name,)) for name in types]
    for name in numbers:
        if not types[name].startswith("uint"):
            found.append(Feature("abs", (name,)))
        if types[name].startswith("float"):
            found += [Feature("nan", (name,)), Feature("nonfinite", (name,))]
    for index, left in enumerate(numbers):
        for right in numbers[index + 1 :]:
            kinds = ["mul", "sub", "add", "div", "hypot", "maxabs", "minabs"]
            if types[left] == types[right] and types[left].startswith("uint"):
                kinds.append("wrap" + types[left].removeprefix("uint"))
            found += [Feature(kind, (left, right)) for kind in kinds]
            found.append(Feature("div", (right, left)))
    return sorted(found, key=lambda feature: feature.cost)
