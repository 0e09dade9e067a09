"""Derived features: the quantities that the literals of a rule compare (rules need x * y, not boxes)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np

from riot_bus.generalize.expressions import Applied, Array, Name, Node, evaluate, text
from riot_bus.generalize.numbers import number_bits
from riot_bus.vocabulary.elements import quantity_of
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

Constant = int | str | bytes | tuple[int | float, ...] | None

_MOST_TERMS = 4  # as many as `edges.linear_features` combines; more are hard to read
_LONGEST_TEXT = 64  # the learner tries up to four letters; longer texts come only from rules in files
_LARGEST = 2**64  # divisors, masks and coefficients beyond the largest integer type of a field are mistakes


class Kind(NamedTuple):
    """One kind of feature: number of variables (0: two to four), cost in bits, and its expression."""

    arity: int
    bits: float
    build: Callable[[list[Node], Any], Node]


def _call(operator: str, *more: Node) -> Callable[[list[Node], Any], Node]:
    return lambda args, _: Applied(operator, (*args, *more))


def _of_sizes(operator: str) -> Callable[[list[Node], Any], Node]:
    return lambda args, _: Applied(operator, tuple(Applied("abs", (arg,)) for arg in args))


def _wrapped(operator: str, bits: int, *, signed: bool) -> Callable[[list[Node], Any], Node]:
    outer, limit = ("signed", bits) if signed else ("mod", 2**bits)
    return lambda args, _: Applied(outer, (Applied(operator, tuple(args)), limit))


def _weighted(args: list[Node], constant: tuple[int | float, ...]) -> Node:
    """Return the sum of the parts with positive coefficients, minus the sum of those with negative ones."""
    sides: list[Node | None] = [None, None]
    for arg, weight in zip(args, constant, strict=True):
        part = arg if abs(weight) == 1 else Applied("mul", (abs(weight), arg))
        side = int(weight < 0)
        before = sides[side]
        sides[side] = part if before is None else Applied("add", (before, part))
    plus, minus = sides
    assert plus is not None  # the first coefficient is positive
    return plus if minus is None else Applied("sub", (plus, minus))


FEATURE_KINDS: Final[Mapping[str, Kind]] = {
    "raw": Kind(1, 1.0, lambda args, _: args[0]),
    "abs": Kind(1, 3.0, _call("abs")),
    "mul": Kind(2, 4.0, _call("mul")),
    "sub": Kind(2, 4.0, _call("sub")),
    "add": Kind(2, 4.5, _call("add")),
    "div": Kind(2, 5.0, _call("div")),
    "hypot": Kind(2, 6.5, _call("hypot")),
    "maxabs": Kind(2, 6.0, _of_sizes("max")),
    "minabs": Kind(2, 6.5, _of_sizes("min")),
    **{
        f"{way}{name}{bits}": Kind(2, 7.0, _wrapped(operator, bits, signed=way == "signed"))
        for way in ("wrap", "signed")
        for name, operator in (("", "add"), ("sub", "sub"), ("mul", "mul"))
        for bits in (8, 16, 32, 64)
    },
    **{f"cast{bits}": Kind(1, 4.0, _call("signed", bits)) for bits in (8, 16, 32)},
    "mul3": Kind(3, 6.0, lambda args, _: Applied("mul", (Applied("mul", (args[0], args[1])), args[2]))),
    "mulsub": Kind(3, 7.0, lambda args, _: Applied("sub", (Applied("mul", (args[0], args[1])), args[2]))),
    "linear": Kind(0, 5.0, _weighted),
    "mod": Kind(1, 2.0, lambda args, constant: Applied("mod", (args[0], constant))),
    "bits": Kind(1, 4.0, lambda args, constant: Applied("and", (args[0], constant))),
    "len": Kind(1, 2.5, _call("len")),
    "bytes": Kind(1, 3.5, _call("bytes")),
    "nan": Kind(1, 3.0, _call("isnan")),
    "nonfinite": Kind(1, 3.5, lambda args, _: Applied("not", (Applied("isfinite", tuple(args)),))),
    "ascii": Kind(1, 4.0, _call("isascii")),
    "printable": Kind(1, 5.0, _call("isprintable")),
    "digits": Kind(1, 5.0, _call("isdigit")),
    "utf8": Kind(1, 4.0, _call("isutf8")),
    "prefix": Kind(1, 3.0, lambda args, constant: Applied("startswith", (args[0], constant))),
    "contains": Kind(1, 4.0, lambda args, constant: Applied("contains", (args[0], constant))),
}
"""Kinds of features: numeric quantities of one to four variables, quantities of texts, and flags."""

FLAGS: Final = frozenset({"nan", "nonfinite", "ascii", "printable", "digits", "utf8", "prefix", "contains"})
"""Kinds whose values are booleans."""


@dataclass(frozen=True, slots=True, order=True)
class Feature:
    """One derived quantity of up to four variables.

    Args:
        constant: Coefficients of "linear" (the first one is positive), divisor of "mod", mask of "bits", text of
            "prefix" and "contains"; None for all other kinds.

    Raises:
        ConfigError: If the kind is unknown, or the number of variables or the constant is wrong.
    """

    kind: str
    args: tuple[str, ...]
    constant: Constant = None

    def __post_init__(self) -> None:
        if isinstance(self.constant, tuple):  # 2.0 and 2 are one coefficient
            weights = (int(one) if isinstance(one, float) and one.is_integer() else one for one in self.constant)
            object.__setattr__(self, "constant", tuple(weights))
        if self.kind not in FEATURE_KINDS:
            raise ConfigError(f"unknown feature {self.kind!r}", hint=did_you_mean(self.kind, FEATURE_KINDS))
        kind = FEATURE_KINDS[self.kind]
        if len(self.args) != kind.arity and not (kind.arity == 0 and 2 <= len(self.args) <= _MOST_TERMS):
            takes = kind.arity or f"2 to {_MOST_TERMS}"
            raise ConfigError(f"feature {self.kind!r} takes {takes} variables, not {self.args!r}")
        if not self._constant_fits():
            hint = (
                "mod and bits take a positive whole number, prefix and contains a text, linear a coefficient for each "
                "variable (none of them 0, the first one positive), and all others None"
            )
            raise ConfigError(f"feature {self.kind!r} cannot have the constant {self.constant!r}", hint=hint)

    def _constant_fits(self) -> bool:
        constant = self.constant
        if self.kind == "linear" and isinstance(constant, tuple):
            fit = (type(one) in (int, float) and 0 < abs(one) < _LARGEST for one in constant)
            return len(constant) == len(self.args) and all(fit) and constant[0] > 0
        if self.kind in ("mod", "bits"):
            return type(constant) is int and 0 < constant < _LARGEST
        if self.kind in ("prefix", "contains"):
            return isinstance(constant, str | bytes) and 0 < len(constant) <= _LONGEST_TEXT
        return constant is None and self.kind != "linear"

    @property
    def cost(self) -> float:
        """Description length in bits without the choice of variables."""
        bits = FEATURE_KINDS[self.kind].bits
        if isinstance(self.constant, tuple):
            return bits + sum(0.0 if abs(weight) == 1 else number_bits(abs(weight)) for weight in self.constant)
        if isinstance(self.constant, int):
            return bits + number_bits(self.constant)
        return bits + 2.0 * len(self.constant) if self.constant else bits

    @property
    def expression(self) -> Node:
        """The feature as a tree of operators, variables and constants, for rendering."""
        return _expression(self)

    def text(self) -> str:
        """Return the feature as people write it."""
        return text(self.expression)

    def column(self, columns: Mapping[str, Array], index: int = 0) -> Array:
        """Return the raw column of one argument.

        Raises:
            ConfigError: If there is no such column.
        """
        return _column(columns, self.args[index])

    def values(self, columns: Mapping[str, Array]) -> Array | None:
        """Return the feature's value in each row, exact for integers; None if a column's type does not fit it.

        Returns:
            int64, object (exact Python integers beyond int64) or float64. For the kinds in `FLAGS`: bool, or for
            those that test texts float64: 1.0 or 0.0, and NaN in rows without a text.
        """
        return evaluate(self.expression, lambda name: _column(columns, name))


@lru_cache(maxsize=4096)
def _expression(feature: Feature) -> Node:
    return FEATURE_KINDS[feature.kind].build([Name(name) for name in feature.args], feature.constant)


def _column(columns: Mapping[str, Array], name: str) -> Array:
    if name not in columns:
        raise ConfigError(f"the rule needs {name!r}, which is not among the columns", hint=did_you_mean(name, columns))
    return np.asarray(columns[name])


_INTEGER = re.compile(r"u?int(8|16|32|64)")
_MOST_WITH_TRIPLES = 6
"""With more numbers than this, triples of them are left out: there are too many."""


def features_of(types: Mapping[str, str]) -> list[Feature]:
    """Return the features worth trying for variables of these types, cheapest first."""
    numbers = [name for name, type_ in types.items() if type_.startswith(("int", "uint", "float"))]
    found = [Feature("raw", (name,)) for name in types]
    for name in numbers:
        if quantity_of(name):
            continue  # the size of the largest element is no size of an element, and NaN is a quantity of its own
        if not types[name].startswith("uint"):
            found.append(Feature("abs", (name,)))
        if types[name].startswith("float"):
            found += [Feature("nan", (name,)), Feature("nonfinite", (name,))]
    for name, type_ in types.items():
        kinds = {"string": ("len", "bytes", "ascii", "printable", "digits"), "bytes": ("len", "ascii", "utf8")}
        found += [Feature(kind, (name,)) for kind in kinds.get(type_, ())]
    for left, right in combinations(numbers, 2):
        if quantity_of(left) or quantity_of(right):
            found.append(Feature("sub", (left, right)))
            continue
        kinds_of_two = ["mul", "sub", "add", "div", "hypot", "maxabs", "minabs", *_wraps(types[left], types[right])]
        found += [Feature(kind, (left, right)) for kind in kinds_of_two]
        found.append(Feature("div", (right, left)))
        found += [Feature(kind, (right, left)) for kind in kinds_of_two if kind.startswith("wrapsub")]
    plain = [name for name in numbers if not quantity_of(name)]
    for one, two, three in combinations(plain, 3) if len(plain) <= _MOST_WITH_TRIPLES else ():
        found.append(Feature("mul3", (one, two, three)))
        found += [Feature("mulsub", args) for args in ((one, two, three), (one, three, two), (two, three, one))]
        found += [Feature("linear", (one, two, three), (1, *signs)) for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    return sorted(found, key=lambda feature: feature.cost)


_MOST_WITH_CASTS = 4
"""With more integers than this, pairs of them are not cast: there are too many."""


def casts_of(types: Mapping[str, str]) -> list[Feature]:
    """Return features of integers, and of sums, differences and products of two, cast to smaller integers."""
    sizes = {name: int(type_.removeprefix("u")[3:]) for name, type_ in types.items() if _INTEGER.fullmatch(type_)}
    found: list[Feature] = []
    for name, size in sizes.items():
        smaller = [bits for bits in (8, 16, 32) if bits < size]
        found += [Feature(f"cast{bits}", (name,)) for bits in smaller]
        found += [Feature("mod", (name,), 2**bits) for bits in smaller]
    for left, right in combinations(sizes, 2) if len(sizes) <= _MOST_WITH_CASTS else ():
        for bits in (8, 16, 32):
            if bits <= max(sizes[left], sizes[right]):
                kinds = [f"{sign}{operator}{bits}" for sign in ("wrap", "signed") for operator in ("", "sub", "mul")]
                found += [Feature(kind, (left, right)) for kind in kinds]
    return found


def _wraps(left: str, right: str) -> list[str]:
    """Return how sums, differences and products of two integers may wrap around."""
    if left != right or not left.startswith(("int", "uint")):
        return []
    size = left.removeprefix("u").removeprefix("int")
    kinds = [f"signed{size}", f"signedsub{size}", f"signedmul{size}"]
    if left.startswith("uint"):
        kinds += [f"wrap{size}", f"wrapsub{size}", f"wrapmul{size}"]
    elif size == "64":  # the type of all integers in formats without integer sizes
        kinds += ["signed32", "signedmul32", "wrap32", "wrapsub32"]
    return kinds
