"""Rules with every kind of literal, and rows of values in which the odd ones are as frequent as ordinary ones."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from riot_bus.generalize.expressions import TEXTS, Applied
from riot_bus.generalize.features import FEATURE_KINDS, FLAGS, Feature
from riot_bus.generalize.forms.tree import Tree
from riot_bus.generalize.literals import OPERATORS, Literal
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.sampling import integer_range

TYPES = {
    "a:i8": "int8",
    "a:i32": "int32",
    "a:i64": "int64",
    "a:u8": "uint8",
    "a:u32": "uint32",
    "a:u64": "uint64",
    "a:f32": "float32",
    "a:f64": "float64",
    "a:flag": "bool",
    "a:mode": "string",
    "a:blob": "bytes",
}
"""Variables of every type."""

THRESHOLDS: Sequence[float] = (0, 1, -1, 2.5, 200, -1e-3, 4194304, 2**53 + 1, 2**63 - 1, -(2**63), 2**64 - 1, 1e300)
CATEGORIES = {"a:flag": (True, False), "a:mode": ("auto", 'he"ll\n\\o\u00e9\u65e5', ""), "a:blob": (b"\x00\xff?7", b"")}


def numbers() -> list[str]:
    """Return the names of the variables with numbers."""
    return [name for name in TYPES if name not in CATEGORIES]


CONSTANTS: Mapping[str, Any] = {"linear": (3, -2), "mod": 7, "bits": 12}
"""Constants of the kinds of features that have one, but for those of texts."""
SETS = {"a:i8": (-3, 1, 100), "a:u64": (0, 2**63 - 1, 2**64 - 1), "a:f64": (1, -1), **CATEGORIES}


def feature_of(kind: str, args: Sequence[str]) -> Feature:
    """Return a feature of a kind, with a constant if it needs one; `args` may be more than it takes."""
    if kind in ("prefix", "contains"):
        return Feature(
            kind,
            tuple(args[:1]),
            b"\x00" if TYPES.get(args[0]) == "bytes" else "\u00e9" if kind == "contains" else "au",
        )
    return Feature(kind, tuple(args[: FEATURE_KINDS[kind].arity or 2]), CONSTANTS.get(kind))


def takes_texts(kind: str) -> bool:
    """Return whether a kind of feature is of texts."""
    node = feature_of(kind, ("x", "y", "z")).expression
    return isinstance(node, Applied) and node.operator in TEXTS


def operations(tree: Tree) -> set[str]:
    """Return the operations in a tree."""
    return {tree.operation}.union(*map(operations, tree.operands))


def every_literal() -> Iterator[Literal]:
    """Yield literals of each kind of feature over each type, with each operator and each threshold, in some pairing."""
    turn = 0
    for kind in FEATURE_KINDS:
        names = ["a:mode", "a:blob"] if takes_texts(kind) else numbers()
        for place in range(len(names)):
            args = tuple(names[(place + step * (1 + turn % 5)) % len(names)] for step in range(3))
            args = (names[place], *args[1:])
            for operator in OPERATORS:
                flag = operator in ("is", "not")
                if flag == (kind in FLAGS) and operator not in ("in", "not in"):
                    turn += 1
                    value = None if flag else THRESHOLDS[turn % len(THRESHOLDS)]
                    yield Literal(feature_of(kind, args), operator, value)
    for name, values in CATEGORIES.items():
        for value in values:
            for operator in ("==", "!="):
                yield Literal(Feature("raw", (name,)), operator, value)
    for name, members in SETS.items():
        for operator in ("in", "not in") if name != "a:flag" else ():
            yield Literal(Feature("raw", (name,)), operator, members)


def every_rule(*, size: int) -> Iterator[Rule]:
    """Yield rules that have every literal between them, of about `size` literals in terms of one or two."""
    literals = list(every_literal())
    for start in range(0, len(literals), size):
        some = literals[start : start + size]
        yield Rule(tuple(tuple(some[place : place + 1 + place % 2]) for place in range(len(some))))


def value_of(name: str, rng: random.Random) -> Any:
    """Return a random value of a variable."""
    kind = TYPES[name]
    if name in CATEGORIES:
        return rng.choice(CATEGORIES[name])
    limits = integer_range(kind)
    if limits is not None:
        low, high = limits
        near = rng.choice([*THRESHOLDS, low, high, 0, 2**31, 2**32, 100])
        choice = rng.choice([rng.randint(low, high), math.floor(near) + rng.randint(-2, 2), rng.randint(-9, 9)])
        return min(max(choice, low), high)
    special = [math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, 1.7e308, *map(float, THRESHOLDS)]
    value = rng.choice([rng.choice(special), rng.uniform(-9, 9), rng.gauss(0, 1) * 10.0 ** rng.randint(-30, 30)])
    if rng.random() < 0.2:
        value = math.nextafter(value, rng.choice([math.inf, -math.inf]))
    if kind == "float32":
        with np.errstate(over="ignore"):
            return float(np.float32(value))
    return value


def rows(count: int, *, seed: int, names: Sequence[str] = tuple(TYPES)) -> list[list[Any]]:
    """Return random rows of values, in the order of the names."""
    rng = random.Random(seed)
    return [[value_of(name, rng) for name in names] for _ in range(count)]


def columns(table: Sequence[Sequence[Any]], names: Sequence[str] = tuple(TYPES)) -> Mapping[str, Any]:
    """Return rows as `Rule.predict` takes them."""
    kinds = {"float32": np.float64, "bool": np.bool_, "string": object, "bytes": object}
    return {
        name: np.array([row[place] for row in table], dtype=kinds.get(TYPES[name], TYPES[name]))
        for place, name in enumerate(names)
    }
