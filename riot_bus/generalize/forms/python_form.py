"""A rule as a Python predicate that stands alone."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence

from riot_bus.generalize.forms import standalone
from riot_bus.generalize.forms.tree import Terms, Tree, feature_tree, one_by_one
from riot_bus.generalize.forms.words import comparison, identifiers, is_float, is_misfit
from riot_bus.generalize.literals import Literal

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


def python_predicate(terms: Terms, *, types: Mapping[str, str], told: str) -> str:
    """Return the source of a standalone predicate `rule(v)` over a dict of variables."""
    words = identifiers(list(types))
    predicate = "\n        or ".join(f"({term_text(term, words, types)})" for term in terms) or "False"
    used = {each.__name__ for each in _HELPERS if f"{each.__name__}(" in predicate}
    used |= {"larger"} if "smaller" in used else set()  # `smaller` calls it
    helpers = "".join(f"{inspect.getsource(each)}\n\n" for each in _HELPERS if each.__name__ in used)
    head = "import math\n\n\n" if helpers or "math." in predicate else ""
    read = [(word, name) for name, word in words.items() if re.search(rf"\b{word}\b", predicate)]
    values = "".join(f"    {word} = v[{name!a}]\n" for word, name in read)
    return f"{head}{helpers}def rule(v):\n    {told!a}\n{values}    return (\n        {predicate}\n    )\n"


_HELPERS = (standalone.div, standalone.larger, standalone.smaller)


def term_text(term: Sequence[Literal], words: Mapping[str, str], types: Mapping[str, str]) -> str:
    """Return a conjunction of literals as a Python expression over the words for its variables."""
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
    text, floating = expression_text(tree, words), is_float(tree, types)
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


def expression_text(tree: Tree, words: Mapping[str, str]) -> str:
    """Return a tree as a Python expression."""
    if tree.operation == "variable":
        return words[str(tree.value)]
    if tree.operation == "constant":
        return ascii(tree.value)
    parts = []
    for each in tree.operands:
        text = expression_text(each, words)
        whole = each.operation in ("variable", "constant") or OPERATIONS[each.operation].endswith(")")
        inside = OPERATIONS[tree.operation].endswith(")")
        parts.append(text if whole or inside else f"({text})")
    return OPERATIONS[tree.operation].format(*parts)
