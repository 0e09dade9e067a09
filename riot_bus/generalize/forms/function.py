"""A rule as a function on single values, for judging one message after another."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from riot_bus.generalize.expressions import TEXTS, Applied, of_text
from riot_bus.generalize.forms.standalone import div, larger, leg, quotient, smaller
from riot_bus.generalize.forms.tree import Terms, Tree, feature_tree, one_by_one
from riot_bus.generalize.literals import Literal
from riot_bus.vocabulary.message import Scalar

Judge = Callable[[Sequence[Any]], bool]
"""Function that returns whether values, in a given order of names, meet a rule."""

_HUGE = 2**1023
"""Integers from here on count as infinite: they are too large for floating-point numbers."""


OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "negative": operator.neg,
    "abs": abs,
    "nan": lambda value: value != value,
    "nonfinite": lambda value: isinstance(value, float) and not math.isfinite(value),
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": div,
    "mod": operator.mod,
    "bitand": lambda a, b: math.nan if isinstance(a, float) else a & b,
    "hypot": lambda a, b: math.hypot(float(a), float(b)),
    "max": larger,
    "min": smaller,
    "quotient": quotient,
    "leg": leg,
}

_COMPARE: Mapping[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": lambda a, b: a != b and a == a,  # false for NaN: it is not a number at all
}


def compiled(tree: Tree, names: Sequence[str]) -> Callable[[Sequence[Any]], Any]:
    """Return the function of a tree on values in the order of names."""
    if tree.operation == "variable":
        return operator.itemgetter(names.index(str(tree.value)))
    if tree.operation == "constant":
        value = tree.value
        return lambda _: value
    operate = OPERATIONS[tree.operation]
    parts = [compiled(each, names) for each in tree.operands]
    if len(parts) == 1:
        (only,) = parts
        return lambda values: operate(only(values))
    left, right = parts
    return lambda values: operate(left(values), right(values))


def judge_of(terms: Terms, names: Sequence[str]) -> Judge:
    """Return a function that judges a single row as `Rule.predict` does; it never raises."""
    judges = term_judges(terms, names)
    return judges[0] if len(judges) == 1 else lambda values: any(judge(values) for judge in judges)


def term_judges(terms: Terms, names: Sequence[str]) -> list[Judge]:
    """Return such a function for each term alone."""
    return [_all([_literal(literal, names) for literal in term]) for term in terms]


def _all(literals: list[Judge]) -> Judge:
    return literals[0] if len(literals) == 1 else lambda values: all(judge(values) for judge in literals)


def _literal(literal: Literal, names: Sequence[str]) -> Judge:
    feature, wanted = literal.feature, literal.value
    places = [names.index(name) for name in feature.args]
    if isinstance(wanted, tuple):
        judges = [_literal(each, names) for each in one_by_one(literal)]
        return _all(judges) if literal.operator == "not in" else lambda values: any(judge(values) for judge in judges)
    node = feature.expression
    if isinstance(node, Applied) and node.operator in TEXTS:
        return _of_texts(literal, node, places[0])
    if isinstance(wanted, bool | str | bytes):
        return _same(places[0], wanted, equal=literal.operator == "==")
    value = compiled(feature_tree(feature), names)
    if wanted is None:
        flag = literal.operator == "is"
        return _numbers(places, lambda values: value(values) is flag)
    compare, exact, rounded = _COMPARE[literal.operator], wanted, float(wanted)

    def judge(values: Sequence[Any]) -> bool:
        found = value(values)
        return compare(found, rounded if type(found) is float else exact)

    return _numbers(places, judge)


def _of_texts(literal: Literal, node: Applied, place: int) -> Judge:
    operator, constants, wanted = node.operator, node.args[1:], literal.value
    if wanted is None:
        flag = literal.operator == "is"
        compare: Callable[[Any, Any], bool] = lambda found, _: bool(found) is flag  # noqa: E731
    else:
        compare = _COMPARE[literal.operator]

    def judge(values: Sequence[Any]) -> bool:
        found = of_text(operator, values[place], constants)
        return found is not None and compare(found, wanted)

    return judge


def _same(place: int, wanted: Scalar, *, equal: bool) -> Judge:
    kind = type(wanted)
    return lambda values: type(values[place]) is kind and (values[place] == wanted) is equal


def _numbers(places: list[int], judge: Judge) -> Judge:
    """Return a judge that is False if a value is not a number, and accepts integers too large for a float."""

    def checked(values: Sequence[Any]) -> bool:
        for place in places:
            if not isinstance(values[place], (int, float)):
                return False
        try:
            return judge(values)
        except OverflowError:
            return judge([_as_float(value) for value in values])

    return checked


def _as_float(value: Any) -> Any:
    if isinstance(value, int) and abs(value) >= _HUGE:
        return math.inf if value > 0 else -math.inf
    return value
