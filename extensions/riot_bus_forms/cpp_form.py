"""A rule as a C++17 header: a predicate, and a function that moves values to the nearest ones without failure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from riot_bus.generalize.forms.repair import unit_of, where_it_changes, why_not_repairable
from riot_bus.generalize.forms.standalone import FLOATS, INTEGERS
from riot_bus.generalize.forms.tree import Terms, Tree, feature_tree, one_by_one
from riot_bus.generalize.forms.words import comparison, identifiers, is_float, is_misfit, line
from riot_bus.generalize.literals import Literal
from riot_bus.vocabulary.elements import is_counted
from riot_bus.vocabulary.errors import ConfigError

OPERATIONS: Mapping[str, str | None] = {
    "negative": "-{0}",
    "abs": "magnitude({0})",
    "nan": "std::isnan({0})",
    "nonfinite": "!std::isfinite({0})",
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "mul": "{0} * {1}",
    "div": "{0} / {1}",
    "mod": "wrapped({0}, {1})",
    "bitand": "({0} & {1})",
    "hypot": "std::hypot({0}, {1})",
    "max": "larger({0}, {1})",
    "min": "smaller({0}, {1})",
    **dict.fromkeys(("len", "bytes", "isascii", "isprintable", "isdigit", "isutf8", "startswith", "contains")),
    "quotient": "quotient({0}, {1})",
    "leg": "leg({0}, {1})",
}
"""None: the C++ standard library has no such operation on UTF-8."""
_ALWAYS_DOUBLE = frozenset({"div", "hypot", "leg"})
_TYPES = {
    **{name: f"std::{name}_t" for name in INTEGERS},
    "float32": "float",
    "float64": "double",
    "bool": "bool",
    "string": "std::string",
    "bytes": "std::string",
}
_SMALL, _LARGE = 2**63 - 16, 2**127 - 16
"""Limits of the 64-bit and 128-bit integers of a header; a little less, so that a step beside a root fits, too."""
_PARTS = re.compile(r"^//%% (\w+)\n(.*?)(?=^//%% |\Z)", re.MULTILINE | re.DOTALL)
_TEMPLATE = dict(_PARTS.findall((Path(__file__).parent / "sanitize.hpp.txt").read_text(encoding="utf-8")))


def cpp_file(
    terms: Terms, *, types: Mapping[str, str], scale: Mapping[str, float], name: str, told: Sequence[str]
) -> str:
    """Return the text of a C++17 header without dependencies.

    Args:
        name: Name of the namespace: letters, digits and underscores.
        told: Lines for the reader: what it is about, and the rule.

    Raises:
        ConfigError: The rule needs integers of more than 127 bits, or an operation on texts that C++ lacks.
    """
    names = list(types)
    movable = [each for each in names if not is_counted(each)]
    why = why_not_repairable(terms, movable, types)
    changes = [] if why else where_it_changes(terms, movable, types)
    trees = [feature_tree(literal.feature) for term in terms for literal in term] + [root for _, root, _ in changes]
    for tree in trees:
        _check(tree)
    writer = _Writer(types, wide=any(_largest(each, types) >= _SMALL for each in trees))
    text = "\n         + ".join(f"int({writer.term(term)})" for term in terms) or "0"
    parts = [
        _TEMPLATE["head"],
        "\n".join(f"// {line(each)}" for each in told),
        _TEMPLATE["includes"],
        f"namespace {name} {{\n",
        "/// The values that the rule is about.\nstruct Input {",
        *(f"  {_TYPES[types[each]]} {word}{{}};  // {line(each)}" for each, word in writer.words.items()),
        "};\n",
        _TEMPLATE["wide" if writer.wide else "narrow"],
        _TEMPLATE["arithmetic"],
        _TEMPLATE["predicate"].replace("TERMS", text),
    ]
    if why:
        parts.append(f"// No sanitize: {line(why)}\n")
    else:
        numbers = [word for each, word in writer.words.items() if types[each] in INTEGERS or types[each] in FLOATS]
        moves = [
            f"    search.moves(&Input::{writer.words[each]}, {writer.root(root)}, {_double(float(value))}, "
            f"{_double(unit_of(scale, each))});"
            for each, root, value in changes
        ]
        sizes = ", ".join(f"detail::size(v.{word})" for word in numbers)
        sanitize = _TEMPLATE["sanitize"].replace("SIZES", sizes).replace("COUNT", str(len(terms) + 1))
        parts += [_TEMPLATE["search"], sanitize.replace("MOVES", "\n".join(moves))]
    return "\n".join([*parts, f"}}  // namespace {name}\n"])


class _Writer:
    def __init__(self, types: Mapping[str, str], *, wide: bool) -> None:
        self.types, self.wide = types, wide
        self.words = identifiers(list(types))

    def term(self, term: Sequence[Literal]) -> str:
        return " && ".join(self._literal(each) for each in term) or "true"

    def root(self, tree: Tree) -> str:
        return self._expression(tree, floating=is_float(tree, self.types))

    def _literal(self, literal: Literal) -> str:
        value = literal.value
        if isinstance(value, tuple):
            parts = [self._literal(each) for each in one_by_one(literal)]
            return f"({(' || ' if literal.operator == 'in' else ' && ').join(parts)})"
        if is_misfit(literal, self.types):
            return "false"
        if isinstance(value, bool):
            negated = value != (literal.operator == "==")
            return f"{'!' if negated else ''}v.{self.words[literal.feature.args[0]]}"
        if isinstance(value, str | bytes):
            return f"(v.{self.words[literal.feature.args[0]]} {literal.operator} {_string(value)})"
        tree = feature_tree(literal.feature)
        floating = is_float(tree, self.types)
        if value is None:
            if not floating:
                return "false" if literal.operator == "is" else "true"  # integers are numbers, and finite
            text = self._expression(tree, floating=True)
            return f"({text})" if literal.operator == "is" else f"!({text})"
        compared = comparison(literal, floating=floating)
        if isinstance(compared, bool):
            return str(compared).lower()
        operator, number = compared
        text = self._expression(tree, floating=floating)
        if floating:
            return f"differs({text}, {number!r})" if operator == "!=" else f"({text} {operator} {_double(number)})"
        low, high = _bounds(tree, self.types)
        if not low <= number <= high:  # a constant, which spares a compiler warning
            truth = {"<": number > high, "<=": number > high, ">": number < low, ">=": number < low, "!=": True}
            return str(truth.get(operator, False)).lower()
        return f"({text} {operator} {self._integer(int(number))})"

    def _integer(self, value: int) -> str:
        if -(2**31) < value < 2**31:
            return str(value)
        if -(2**63) < value < 2**63:
            return f"INT64_C({value})"
        if not self.wide or abs(value) >= _LARGE:
            raise _too_large()
        high, low = divmod(value, 2**64)
        return f"wide({self._integer(high)}, UINT64_C({low}))"

    def _expression(self, tree: Tree, *, floating: bool) -> str:
        """Return the text of a tree, as a double or an Integer."""
        if tree.operation == "variable":
            return f"{'double' if floating else 'Integer'}(v.{self.words[str(tree.value)]})"
        if tree.operation == "constant":
            assert isinstance(tree.value, int | float)
            return _double(float(tree.value)) if floating else f"Integer({self._integer(int(tree.value))})"
        own = is_float(tree, self.types)
        inside = own or tree.operation in _ALWAYS_DOUBLE
        parts = [self._operand(each, tree.operation, floating=inside) for each in tree.operands]
        form = _form(tree.operation)
        if tree.operation == "mul" and not inside and _largest(tree, self.types) >= _LARGE:
            form = "product({0}, {1})"
        elif not inside and _largest(tree, self.types) >= _LARGE:
            raise _too_large()
        text = form.format(*parts)
        return f"double({text})" if floating and not own else text

    def _operand(self, tree: Tree, operation: str, *, floating: bool) -> str:
        text = self._expression(tree, floating=floating)
        whole = tree.operation in ("variable", "constant") or _form(tree.operation).endswith(")")
        return text if whole or _form(operation).endswith(")") else f"({text})"


def _form(operation: str) -> str:
    form = OPERATIONS[operation]
    if form is None:
        raise ConfigError(f"C++ has no {operation} of texts in UTF-8")
    return form


def _check(tree: Tree) -> None:
    if tree.operation not in ("variable", "constant"):
        _form(tree.operation)
    for each in tree.operands:
        _check(each)


def _too_large() -> ConfigError:
    return ConfigError("this rule needs integers of more than 127 bits, which C++ has not")


def _bounds(tree: Tree, types: Mapping[str, str]) -> tuple[int, int]:
    """Return the smallest and largest value of a tree of integers."""
    if tree.operation == "variable":
        return INTEGERS.get(types[str(tree.value)], (0, 1))
    if tree.operation == "constant":
        assert isinstance(tree.value, int | float)
        return int(tree.value), int(tree.value)
    parts = [_bounds(each, types) for each in tree.operands]
    (low, high), (least, most) = parts[0], parts[-1]
    size = max(abs(low), abs(high))
    found = {
        "negative": (-high, -low),
        "abs": (0, size),
        "add": (low + least, high + most),
        "sub": (low - most, high - least),
        "max": (max(low, least), max(high, most)),
        "min": (min(low, least), min(high, most)),
        "mod": (0, most - 1),
        "bitand": (0, most),
        "quotient": (-size - 1, size + 1),
    }
    if tree.operation == "mul":
        corners = [a * b for a in (low, high) for b in (least, most)]
        return min(corners), max(corners)
    return found[tree.operation]


def _largest(tree: Tree, types: Mapping[str, str]) -> int:
    """Return the largest absolute value of an integer in a tree, 0 if there are none."""
    inside = max((_largest(each, types) for each in tree.operands), default=0)
    if is_float(tree, types) or tree.operation in ("nan", "nonfinite"):
        return inside
    return max(inside, *map(abs, _bounds(tree, types)))


def _double(value: float) -> str:
    text = repr(float(value))
    return f"({text})" if text.startswith("-") else text


def _string(value: str | bytes) -> str:
    data = value.encode("utf-8", "surrogatepass") if isinstance(value, str) else value
    plain = "".join(chr(byte) if 32 <= byte < 127 and byte not in b'"\\?' else f"\\{byte:03o}" for byte in data)
    return f'std::string("{plain}", {len(data)})'
