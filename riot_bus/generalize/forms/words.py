"""Helpers that the written forms of a rule share: names for variables, and comparisons with known types."""

from __future__ import annotations

import builtins
import keyword
import math
import re
from collections.abc import Mapping, Sequence

from riot_bus.generalize.expressions import TEXTS, Applied
from riot_bus.generalize.forms.standalone import FLOATS
from riot_bus.generalize.forms.tree import Tree
from riot_bus.generalize.literals import Literal

_CPP = (
    "alignas alignof and and_eq asm auto bitand bitor bool case catch char class compl const constexpr "
    "const_cast decltype default delete do double dynamic_cast else enum explicit export extern false float "
    "for friend goto if inline int long mutable namespace new noexcept not not_eq nullptr operator or or_eq "
    "private protected public register reinterpret_cast return short signed sizeof static static_assert "
    "static_cast struct switch template this thread_local throw true try typedef typeid typename union "
    "unsigned using virtual void volatile wchar_t while xor xor_eq"
)
_STL = "always eventually until historically once since implies iff abs sqrt exp pow F G U H O S next prev rise fall"
_OURS = "math struct div quotient leg larger smaller nearest candidates near single is_dangerous sanitize v TERMS ROOTS"
_TAKEN = frozenset([*keyword.kwlist, *keyword.softkwlist, *dir(builtins), *_CPP.split(), *_STL.split(), *_OURS.split()])
_FLOAT_OPERATIONS = frozenset({"div", "hypot", "leg"})
_LONGEST = 60  # keeps lines of generated code readable; a number tells equal beginnings apart


def identifiers(names: Sequence[str]) -> dict[str, str]:
    """Return for each name a distinct identifier that is valid in Python, C++ and formulas."""
    found: dict[str, str] = {}
    for name in names:
        word = re.sub(r"[^A-Za-z0-9]+", "_", name)[:_LONGEST].strip("_").lower()
        word = word if word[:1].isalpha() else f"field_{word}".rstrip("_")
        word = f"{word}_value" if word in _TAKEN else word
        number, unique = 2, word
        while unique in found.values():
            unique, number = f"{word}_{number}", number + 1
        found[name] = unique
    return found


def is_float(tree: Tree, types: Mapping[str, str]) -> bool:
    """Return whether a tree has floating-point values where variables have these types."""
    if tree.operation == "variable":
        return types.get(str(tree.value)) in FLOATS
    if tree.operation == "constant":
        return isinstance(tree.value, float)
    return tree.operation in _FLOAT_OPERATIONS or any(is_float(each, types) for each in tree.operands)


def is_misfit(literal: Literal, types: Mapping[str, str]) -> bool:
    """Return whether a literal never holds, since it compares with a value of another type than its variable has."""
    feature = literal.feature
    kinds = {types[name] for name in feature.args}
    node = feature.expression
    if isinstance(node, Applied) and node.operator in TEXTS:
        allowed = {"isutf8": {"bytes"}, "isprintable": {"string"}}.get(node.operator, {"string", "bytes"})
        if len(node.args) > 1:
            allowed = {"bytes"} if isinstance(node.args[1], bytes) else {"string"}
        return not kinds <= allowed
    if feature.kind == "bits" and kinds & set(FLOATS):
        return True
    wanted = {bool: {"bool"}, str: {"string"}, bytes: {"bytes"}}.get(type(literal.value))
    return kinds != wanted if wanted else bool(kinds & {"string", "bytes"})


def comparison(literal: Literal, *, floating: bool) -> tuple[str, int | float] | bool:
    """Return the operator and number of a literal in the type of its feature, or its truth if values do not matter."""
    operator, value = literal.operator, literal.value
    assert isinstance(value, int | float)
    if floating:
        return operator, float(value)
    if isinstance(value, int) or value.is_integer():
        return operator, int(value)
    if operator in ("==", "!="):
        return operator == "!="
    return {">=": ">", "<": "<="}.get(operator, operator), math.floor(value)


def line(text: str) -> str:
    """Return untrusted text as one printable line in quotes, which neither ends a comment nor continues it."""
    shown = text.encode("unicode_escape", "backslashreplace").decode("ascii").replace('"', "'")
    return f'"{shown}"'
