"""Features as trees of a few operations: every form of a rule renders these, so that no kind of feature is forgotten.

A new kind of feature needs a tree here, and roots or a word why it has none; a new operation needs a rendering in each
form. Tests go through all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from riot_bus.generalize.features import Feature
    from riot_bus.generalize.literals import Literal

__all__ = [
    "FEATURES",
    "NO_ROOTS",
    "OPERATIONS",
    "ROOTS",
    "Terms",
    "Tree",
    "constant",
    "feature_tree",
    "roots",
    "variable",
]

Terms = tuple[tuple["Literal", ...], ...]

OPERATIONS: Mapping[str, int] = {
    "variable": 0,
    "constant": 0,
    "negative": 1,
    "abs": 1,
    "nan": 1,
    "nonfinite": 1,
    "add": 2,
    "sub": 2,
    "mul": 2,
    "div": 2,
    "mod": 2,
    "hypot": 2,
    "max": 2,
    "min": 2,
    "quotient": 2,
    "leg": 2,
}
"""Operations and how many operands they have. Integers are exact, but for `div`, `hypot` and `leg`.

`quotient` is a / b, of integers a whole number next to it; `leg` is the other leg of the hypotenuse a and the leg b.
Both are NaN where there is no such number, and stand in roots alone.
"""


@dataclass(frozen=True, slots=True)
class Tree:
    """One operation and its operands; `value` is the name of a variable or the number of a constant."""

    operation: str
    operands: tuple[Tree, ...] = ()
    value: str | int | float = 0

    def variables(self) -> set[str]:
        """Return the names of the variables in it."""
        own = {self.value} if self.operation == "variable" and isinstance(self.value, str) else set()
        return own.union(*(each.variables() for each in self.operands))


def variable(name: str) -> Tree:
    """Return the tree of a variable."""
    return Tree("variable", value=name)


def constant(value: float) -> Tree:
    """Return the tree of a number."""
    return Tree("constant", value=value)


def _operation(name: str) -> Callable[..., Tree]:
    return lambda *operands: Tree(name, operands)


_negative, _abs, _nan, _nonfinite = map(_operation, ("negative", "abs", "nan", "nonfinite"))
_add, _sub, _mul, _div, _mod = map(_operation, ("add", "sub", "mul", "div", "mod"))
_hypot, _max, _min, _quotient, _leg = map(_operation, ("hypot", "max", "min", "quotient", "leg"))


def _wrapped(bits: int) -> Callable[[Tree, Tree], Tree]:
    return lambda x, y: _mod(_add(x, y), constant(2**bits))


FEATURES: Mapping[str, Callable[..., Tree]] = {
    "raw": lambda x: x,
    "abs": _abs,
    "mul": _mul,
    "sub": _sub,
    "add": _add,
    "div": _div,
    "hypot": _hypot,
    "maxabs": lambda x, y: _max(_abs(x), _abs(y)),
    "minabs": lambda x, y: _min(_abs(x), _abs(y)),
    "wrap8": _wrapped(8),
    "wrap16": _wrapped(16),
    "wrap32": _wrapped(32),
    "wrap64": _wrapped(64),
    "nan": _nan,
    "nonfinite": _nonfinite,
}
"""The tree of each kind of feature, from those of its variables."""

_Roots = Callable[..., tuple[Tree, ...]]


def _either_sign(t: Tree, *_: Tree) -> tuple[Tree, ...]:
    return t, _negative(t)


def _leg_of(t: Tree, other: Tree) -> tuple[Tree, ...]:
    return _leg(t, other), _negative(_leg(t, other))


ROOTS: Mapping[str, tuple[_Roots, ...]] = {
    "raw": (lambda t: (t,),),
    "abs": (_either_sign,),
    "mul": (lambda t, y: (_quotient(t, y),), lambda t, x: (_quotient(t, x),)),
    "sub": (lambda t, y: (_add(t, y),), lambda t, x: (_sub(x, t),)),
    "add": (lambda t, y: (_sub(t, y),), lambda t, x: (_sub(t, x),)),
    "div": (lambda t, y: (_mul(t, y),), lambda t, x: (_quotient(x, t), constant(0))),
    "hypot": (_leg_of, _leg_of),
    "maxabs": (_either_sign, _either_sign),
    "minabs": (_either_sign, _either_sign),
}
"""By kind of feature and number of the variable: where this variable makes the feature cross t, the others as they are.

Each is called with the trees of t and of the other variables in their order.
"""

NO_ROOTS: Mapping[str, str] = {
    **dict.fromkeys(
        ("wrap8", "wrap16", "wrap32", "wrap64"), "a sum that wraps comes back to the same value again and again"
    ),
    **dict.fromkeys(("nan", "nonfinite"), "what is not a number has no nearest number"),
}
"""Kinds of features of which nothing can be said to be the nearest value, and why."""


def feature_tree(feature: Feature) -> Tree:
    """Return the tree of a feature.

    Raises:
        ConfigError: There is none for its kind, so the rule has no other form than its own.
    """
    if feature.kind not in FEATURES:
        raise ConfigError(f"nobody has said yet how {feature.text()!r} is written elsewhere")
    return FEATURES[feature.kind](*map(variable, feature.args))


def roots(literal: Literal, name: str) -> tuple[Tree, ...]:
    """Return where a variable makes a literal change; empty if that is not known, or if it has no numbers.

    Args:
        literal: The literal.
        name: The variable.
    """
    feature = literal.feature
    if feature.kind not in ROOTS or isinstance(literal.value, bool) or not isinstance(literal.value, int | float):
        return ()
    if feature.args.count(name) != 1:
        return ()
    place = feature.args.index(name)
    others = [variable(each) for each in feature.args if each != name]
    return ROOTS[feature.kind][place](constant(literal.value), *others)
