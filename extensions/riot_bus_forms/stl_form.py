"""A rule as a formula of signal temporal logic for the monitor `stl`, which says that the rule never holds."""

from __future__ import annotations

import re
from collections.abc import Mapping

from riot_bus.generalize.forms.tree import Terms, Tree, feature_tree, one_by_one
from riot_bus.generalize.forms.words import comparison, identifiers, is_float, is_misfit
from riot_bus.generalize.literals import Literal
from riot_bus.vocabulary.order import order_of

OPERATIONS: Mapping[str, str | None] = {
    "negative": "(0 - {0})",
    "abs": "abs({0})",
    "nan": None,
    "nonfinite": None,
    "add": "({0} + {1})",
    "sub": "({0} - {1})",
    "mul": "({0} * {1})",
    "div": "({0} / {1})",
    "mod": None,
    "hypot": "sqrt(({0} * {0}) + ({1} * {1}))",
    **dict.fromkeys(("bitand", "max", "min", "quotient", "leg")),
    **dict.fromkeys(("len", "bytes", "isascii", "isprintable", "isdigit", "isutf8", "startswith", "contains")),
}
"""None: the language has no such operation."""

_HALVES: Mapping[str, str] = {
    ">": "({0} > {2})",
    ">=": "({0} > {1})",
    "<": "({0} < {1})",
    "<=": "({0} < {2})",
    "==": "(({0} > {1}) and ({0} < {2}))",
    "!=": "(({0} < {1}) or ({0} > {2}))",
}
"""How integers compare with n, between n - 1/2 and n + 1/2: at a limit itself a formula is neither true nor false."""


_NUMBERED = re.compile(r".+\[\d+\]:[^:]*", re.DOTALL)


class NoFormulaError(ValueError):
    """The rule cannot be expressed in this language; the message says why."""


def stl_formula(terms: Terms, *, types: Mapping[str, str]) -> tuple[str, dict[str, str]]:
    """Return the formula, and the field of each of its signals.

    Raises:
        NoFormulaError: The language cannot express the rule.
    """
    words = identifiers(list(types))
    used = {name for term in terms for literal in term for name in literal.feature.args}
    for name in sorted(used):
        if order_of(name) or _NUMBERED.fullmatch(name):
            raise NoFormulaError(f"{name!r}: a signal is a field of the latest message")
    parts = []
    for term in terms:
        literals = [_literal(each, words, types) for each in term]
        if not literals:
            raise NoFormulaError("the rule always holds")
        parts.append(" and ".join(literals) if len(literals) == 1 else f"({' and '.join(literals)})")
    if not parts:
        raise NoFormulaError("the rule never holds")
    return f"always (not ({' or '.join(parts)}))", {words[name]: name for name in types if name in used}


def _literal(literal: Literal, words: Mapping[str, str], types: Mapping[str, str]) -> str:
    value, operator = literal.value, literal.operator
    if isinstance(value, tuple):
        parts = [_literal(each, words, types) for each in one_by_one(literal)]
        return f"({(' or ' if operator == 'in' else ' and ').join(parts)})"
    if is_misfit(literal, types) or isinstance(value, str | bytes):
        raise NoFormulaError(f"{literal.text()!r}: signals are numbers")
    if isinstance(value, bool):
        return f"({words[literal.feature.args[0]]} {'>' if value == (operator == '==') else '<'} 0.5)"
    tree = feature_tree(literal.feature)
    floating, text = is_float(tree, types), _expression(tree, words)
    if text is None or value is None:
        raise NoFormulaError(f"{literal.text()!r}: the language has no such operation")
    compared = comparison(literal, floating=floating)
    if isinstance(compared, bool):
        raise NoFormulaError(f"{literal.text()!r} is {'always' if compared else 'never'} so")
    operator, number = compared
    if not floating:
        return _HALVES[operator].format(text, _number(number - 0.5), _number(number + 0.5))
    if operator in ("==", "!="):
        raise NoFormulaError(f"{literal.text()!r}: at a limit itself a formula is neither true nor false")
    return f"({text} {operator} {_number(number)})"


def _expression(tree: Tree, words: Mapping[str, str]) -> str | None:
    if tree.operation == "variable":
        return words[str(tree.value)]
    if tree.operation == "constant":
        return _number(tree.value) if isinstance(tree.value, int | float) else None
    form, parts = OPERATIONS[tree.operation], [_expression(each, words) for each in tree.operands]
    return None if form is None or None in parts else form.format(*parts)


def _number(value: float) -> str:
    return repr(value) if value >= 0 else f"(0 - {-value!r})"
