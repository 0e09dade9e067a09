"""Features as trees of a few operations: every form of a rule renders these, so that no kind of feature is forgotten.

A new kind of feature needs roots here, or a reason why it has none; a new operation needs a rendering in each form.
Tests go through all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce

from riot_bus.generalize.expressions import Applied, Name, Node, text
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.vocabulary.errors import ConfigError

Terms = tuple[tuple[Literal, ...], ...]

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
    "bitand": 2,
    "hypot": 2,
    "max": 2,
    "min": 2,
    **dict.fromkeys(("len", "bytes", "isascii", "isprintable", "isdigit", "isutf8"), 1),
    **dict.fromkeys(("startswith", "contains"), 2),
    "quotient": 2,
    "leg": 2,
}
"""Operations and their numbers of operands. Integers are exact, except in `div`, `hypot` and `leg`.

They are those of `riot_bus.generalize.expressions`, some under another name. `quotient` is a / b, for integers a whole
number next to it; `leg` is the other leg of a triangle with the hypotenuse a and the leg b. Both are NaN if there is no
such number, and occur only in roots.
"""


@dataclass(frozen=True, slots=True)
class Tree:
    """One operation and its operands; `value` is the name of a variable or the value of a constant."""

    operation: str
    operands: tuple[Tree, ...] = ()
    value: str | bytes | int | float = 0

    def variables(self) -> set[str]:
        """Return the names of the variables in it."""
        own = {self.value} if self.operation == "variable" and isinstance(self.value, str) else set()
        return own.union(*(each.variables() for each in self.operands))


def variable(name: str) -> Tree:
    """Return the tree of a variable."""
    return Tree("variable", value=name)


def constant(value: str | bytes | float) -> Tree:
    """Return the tree of a number or a text."""
    return Tree("constant", value=value)


def _operation(name: str) -> Callable[..., Tree]:
    return lambda *operands: Tree(name, operands)


_negative, _add, _sub, _mul = map(_operation, ("negative", "add", "sub", "mul"))
_quotient, _leg = map(_operation, ("quotient", "leg"))

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
    "mul3": 3 * (lambda t, x, y: (_quotient(t, _mul(x, y)),),),
    "mulsub": (
        lambda t, y, z: (_quotient(_add(t, z), y),),
        lambda t, x, z: (_quotient(_add(t, z), x),),
        lambda t, x, y: (_sub(_mul(x, y), t),),
    ),
    "linear": (),  # from its coefficients, by `roots`
}
"""By kind of feature and index of the variable: its values at which the feature crosses t, the others being fixed.

Each is called with the trees of t and of the other variables in their order.
"""

_AGAIN = "what wraps around comes back to the same value again and again"
_TEXT = "a text has no nearest one"
NO_ROOTS: Mapping[str, str] = {
    **{
        f"{kind}{bits}": _AGAIN
        for kind in ("wrap", "wrapsub", "wrapmul", "signed", "signedsub", "signedmul")
        for bits in (8, 16, 32, 64)
    },
    **{f"cast{bits}": _AGAIN for bits in (8, 16, 32)},
    **dict.fromkeys(("mod", "bits"), "remainders and bits come back again and again"),
    **dict.fromkeys(("len", "bytes", "ascii", "printable", "digits", "utf8", "prefix", "contains"), _TEXT),
    **dict.fromkeys(("nan", "nonfinite"), "what is not a number has no nearest number"),
}
"""Kinds of features that have no nearest value, and why."""


def feature_tree(feature: Feature) -> Tree:
    """Return the tree of a feature.

    Raises:
        ConfigError: An operator of the feature has no tree, so the rule cannot be written in other forms.
    """
    return _tree(feature.expression)


def _tree(node: Node) -> Tree:
    if isinstance(node, Name):
        return variable(node.name)
    if not isinstance(node, Applied):
        return constant(node)
    if node.operator == "not" and isinstance(node.args[0], Applied) and node.args[0].operator == "isfinite":
        return Tree("nonfinite", (_tree(node.args[0].args[0]),))
    if node.operator == "signed" and isinstance(node.args[1], int):
        half = 2 ** (node.args[1] - 1)
        return _sub(Tree("mod", (_add(_tree(node.args[0]), constant(half)), constant(2 * half))), constant(half))
    operation = {"and": "bitand", "isnan": "nan"}.get(node.operator, node.operator)
    if operation not in OPERATIONS:
        raise ConfigError(f"{text(node)!r} cannot be written in other forms: they lack the operator {operation!r}")
    return Tree(operation, tuple(map(_tree, node.args)))


def one_by_one(literal: Literal) -> tuple[Literal, ...]:
    """Return the literals equivalent to a comparison with a set: any must hold for "in", all for "not in"."""
    assert isinstance(literal.value, tuple)
    operator = "==" if literal.operator == "in" else "!="
    return tuple(Literal(literal.feature, operator, member) for member in literal.value)


def roots(literal: Literal, name: str) -> tuple[Tree, ...]:
    """Return the values of a variable at which a literal changes; empty if not known, or not about numbers."""
    feature = literal.feature
    if feature.kind in NO_ROOTS or isinstance(literal.value, bool) or not isinstance(literal.value, int | float):
        return ()
    if feature.args.count(name) != 1:
        return ()
    place = feature.args.index(name)
    others = [variable(each) for each in feature.args if each != name]
    if isinstance(feature.constant, tuple):
        weights = [weight for number, weight in enumerate(feature.constant) if number != place]
        parts = [_mul(constant(weight), other) for weight, other in zip(weights, others, strict=True)]
        return (_quotient(_sub(constant(literal.value), reduce(_add, parts)), constant(feature.constant[place])),)
    return ROOTS[feature.kind][place](constant(literal.value), *others)
