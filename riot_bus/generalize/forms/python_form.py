"""A rule as a Python file: a predicate, and a function that moves values to the nearest ones without failure."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence

from riot_bus.generalize.forms import standalone
from riot_bus.generalize.forms.repair import unit_of, where_it_changes, why_not_repairable
from riot_bus.generalize.forms.tree import Terms, Tree, feature_tree, one_by_one
from riot_bus.generalize.forms.words import comparison, identifiers, is_float, is_misfit, line
from riot_bus.generalize.literals import Literal
from riot_bus.vocabulary.elements import is_counted

OPERATIONS: Mapping[str, str] = {
    "negative": "-{0}",
    "abs": "abs({0})",
    "nan": "math.isnan({0})",
    "nonfinite": "not math.isfinite({0})",
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "mul": "{0} * {1}",
    "div": "div({0}, {1})",
    "mod": "{0} % {1}",
    "bitand": "({0} & {1})",
    "hypot": "math.hypot({0}, {1})",
    "max": "larger({0}, {1})",
    "min": "smaller({0}, {1})",
    "len": "len({0})",
    "bytes": "len({0}.encode('utf-8', 'surrogatepass'))",
    "isascii": "{0}.isascii()",
    "isprintable": "{0}.isprintable()",
    "isdigit": "{0}.isdigit()",
    "isutf8": "({0}.decode(errors='replace').encode() == {0})",
    "startswith": "{0}.startswith({1})",
    "contains": "({1} in {0})",
    "quotient": "quotient({0}, {1})",
    "leg": "leg({0}, {1})",
}
_HEAD = '''\
"""Tells the inputs on which a unit fails, and moves them to the nearest ones on which it does not.

Written by riot_bus. It needs the standard library alone; what stands below the line is the same in all such files.
"""
{told}

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any

FIELDS = {{
{fields}
}}
"""Where the arguments come from, in their order, and their types."""


def is_dangerous({arguments}):
    """Return whether the unit fails, as the rule says."""
    return (
        {predicate}
    )


{sanitize}
# ----------------------------------------------------------------------------------------------------------------------

{copy}'''
_SANITIZE = '''\
def sanitize({arguments}):
    """Return the arguments, as a list, such that `is_dangerous` is false; None if no such values are near.

    One value moves as little as possible, in units of its nominal spread; more move only where one will not do.
    """
    return nearest([{arguments}], TERMS, ROOTS, KINDS, UNITS)


TERMS = (
{terms}
)
ROOTS = (
{roots}
)
KINDS = {kinds}
UNITS = {units}

'''


def python_file(terms: Terms, *, types: Mapping[str, str], scale: Mapping[str, float], told: Sequence[str]) -> str:
    """Return the text of a Python file."""
    names = list(types)
    words = identifiers(names)
    arguments = ", ".join(words.values())
    fields = [f"    {words[name]!a}: ({name!a}, {types[name]!a})," for name in names]
    return _HEAD.format(
        told="\n".join(f"# {line(each)}" for each in told),
        fields="\n".join(fields),
        arguments=arguments,
        predicate="\n        or ".join(f"({_term(term, words, types)})" for term in terms) or "False",
        sanitize=_sanitize(terms, names, words, types, scale),
        copy=_copy(),
    )


def python_predicate(terms: Terms, *, types: Mapping[str, str], told: str) -> str:
    """Return the source of a standalone predicate `rule(v)` over a dict of variables."""
    words = identifiers(list(types))
    predicate = "\n        or ".join(f"({_term(term, words, types)})" for term in terms) or "False"
    used = {each.__name__ for each in _HELPERS if f"{each.__name__}(" in predicate}
    used |= {"larger"} if "smaller" in used else set()  # `smaller` calls it
    helpers = "".join(f"{inspect.getsource(each)}\n\n" for each in _HELPERS if each.__name__ in used)
    head = "import math\n\n\n" if helpers or "math." in predicate else ""
    read = [(word, name) for name, word in words.items() if re.search(rf"\b{word}\b", predicate)]
    values = "".join(f"    {word} = v[{name!a}]\n" for word, name in read)
    return f"{head}{helpers}def rule(v):\n    {told!a}\n{values}    return (\n        {predicate}\n    )\n"


_HELPERS = (standalone.div, standalone.larger, standalone.smaller)


def _sanitize(
    terms: Terms, names: Sequence[str], words: Mapping[str, str], types: Mapping[str, str], scale: Mapping[str, float]
) -> str:
    movable = [name for name in names if not is_counted(name)]
    if why := why_not_repairable(terms, movable, types):
        return f"# No sanitize: {line(why)}\n\n"
    call = f"lambda {', '.join(words.values())}: "
    changes = where_it_changes(terms, movable, types)
    return _SANITIZE.format(
        arguments=", ".join(words.values()),
        terms="\n".join(f"    {call}{_term(term, words, types)}," for term in terms),
        roots="\n".join(
            f"    ({names.index(name)}, {call}{_expression(root, words)}, {value!r})," for name, root, value in changes
        ),
        kinds=repr([types[name] for name in names]),
        units=repr([unit_of(scale, name) for name in names]),
    )


def _copy() -> str:
    source = inspect.getsource(standalone)
    return source[source.index("INTEGERS = {") :]


def _term(term: Sequence[Literal], words: Mapping[str, str], types: Mapping[str, str]) -> str:
    return " and ".join(_literal(each, words, types) for each in term) or "True"


def _literal(literal: Literal, words: Mapping[str, str], types: Mapping[str, str]) -> str:
    value = literal.value
    if isinstance(value, tuple):
        parts = [_literal(each, words, types) for each in one_by_one(literal)]
        return f"({(' or ' if literal.operator == 'in' else ' and ').join(parts)})"
    if is_misfit(literal, types):
        return "False"
    if isinstance(value, bool):
        return f"{words[literal.feature.args[0]]} is {value == (literal.operator == '==')}"
    if isinstance(value, str | bytes):
        return f"{words[literal.feature.args[0]]} {literal.operator} {value!a}"
    tree = feature_tree(literal.feature)
    if tree.operation == "bytes" and types[literal.feature.args[0]] == "bytes":
        tree = Tree("len", tree.operands)
    text, floating = _expression(tree, words), is_float(tree, types)
    if value is None and tree.operation not in ("nan", "nonfinite"):
        return text if literal.operator == "is" else f"not {text}"
    if value is None:
        if not is_float(tree, types):
            return str(literal.operator == "not")  # integers are numbers, and finite
        return text if literal.operator == "is" else f"not ({text})"
    compared = comparison(literal, floating=floating)
    if isinstance(compared, bool):
        return str(compared)
    operator, number = compared
    if floating and operator == "!=":
        return f"{text} == {text} != {number!r}"  # false for NaN: it is not a number at all
    return f"{text} {operator} {number!r}"


def _expression(tree: Tree, words: Mapping[str, str]) -> str:
    if tree.operation == "variable":
        return words[str(tree.value)]
    if tree.operation == "constant":
        return ascii(tree.value)
    parts = []
    for each in tree.operands:
        text = _expression(each, words)
        whole = each.operation in ("variable", "constant") or OPERATIONS[each.operation].endswith(")")
        inside = OPERATIONS[tree.operation].endswith(")")
        parts.append(text if whole or inside else f"({text})")
    return OPERATIONS[tree.operation].format(*parts)
