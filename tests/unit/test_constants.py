"""Constants say why they have their value: beside them, above them or below them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("riot_bus", "adapters", "dictionaries", "extensions")
PLAIN = {"0", "1", "2", "-1"}
"""Numbers that are what they are."""

SCOPES = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
NOTE = re.compile(r"# *(noqa|fmt:|type:|pragma:|mypy:|--)")
"""Comments that are for tools, and headings: they explain no number."""

CONTAINERS = {"MappingProxyType", "dict", "frozenset", "list", "range", "set", "timedelta", "tuple"}
"""Calls whose arguments are the numbers of a constant."""


def unexplained(text: str) -> list[str]:
    """Return the numeric constants of a module that have no comment in their line or above them, and no text below.

    Those of classes and functions count as well, and containers of numbers, but not members of enums. A text below a
    group of lines, without an empty line between them, explains all of these.
    """
    scopes = (node for node in ast.walk(ast.parse(text)) if isinstance(node, SCOPES) and not is_enum(node))
    return [found for scope in scopes for found in unexplained_in(scope.body, text.splitlines())]


def is_enum(node: ast.AST) -> bool:
    return isinstance(node, ast.ClassDef) and any(ast.unparse(base).endswith(("Enum", "Flag")) for base in node.bases)


def unexplained_in(body: list[ast.stmt], lines: list[str]) -> Iterator[str]:
    for place, node in enumerate(body):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None or not is_tuned(node):
            continue
        first, last = place, place
        while first and follows(body[first - 1], body[first]):
            first -= 1
        while last + 1 < len(body) and follows(body[last], body[last + 1]):
            last += 1
        below = body[last + 1] if last + 1 < len(body) else None
        explained = isinstance(below, ast.Expr) and below.lineno == end(body[last]) + 1
        before = lines[body[first].lineno - 2].strip() if body[first].lineno > 1 else ""
        above = before.startswith("#") and not NOTE.search(before)
        beside = any("  # " in line and not NOTE.search(line) for line in lines[node.lineno - 1 : end(node)])
        if not (explained or above or beside):
            yield ast.unparse(node)


def follows(one: ast.stmt, other: ast.stmt) -> bool:
    """Return whether two assignments stand in lines one after the other."""
    both = isinstance(one, ast.Assign | ast.AnnAssign) and isinstance(other, ast.Assign | ast.AnnAssign)
    return both and other.lineno == end(one) + 1


def end(node: ast.stmt) -> int:
    return node.end_lineno or node.lineno


def is_tuned(node: ast.Assign | ast.AnnAssign) -> bool:
    """Return whether constants get numbers other than 0, 1, 2 and -1."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    names = [name for target in targets for name in (target.elts if isinstance(target, ast.Tuple) else [target])]
    if node.value is None or not all(isinstance(name, ast.Name) and name.id.strip("_").isupper() for name in names):
        return False
    values = parts(node.value)
    return bool(values) and all(map(is_number, values)) and not {ast.unparse(value) for value in values} <= PLAIN


def parts(node: ast.expr) -> list[ast.expr]:
    """Return the values in a container, in those inside it as well; those of a dict without its keys."""
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        inside = node.elts
    elif isinstance(node, ast.Dict):
        inside = node.values
    elif isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in CONTAINERS:
        inside = [*node.args, *(each.value for each in node.keywords)]
    else:
        return [node]
    return [part for each in inside for part in parts(each)]


def is_number(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)


def test_numbers_have_a_reason() -> None:
    files = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    texts = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in files}
    assert {name: told for name, text in texts.items() if (told := unexplained(text))} == {}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("_POLL = 0.004\n", ["_POLL = 0.004"]),
        ("_POLL = 0.004  # a look costs as much\n", []),
        ('_POLL = 0.004\n"""A look costs as much."""\n', []),
        ('_POLL = 0.004\n_MOST = 3\n"""Both are guesses."""\n', []),
        ('_POLL = 0.004\n\n_MOST = 3\n"""A guess."""\n', ["_POLL = 0.004"]),
        ("# both are guesses\n_POLL = 0.004\n_MOST = 3 << 20\n", []),
        ("_A, _B = 1, -3\n_C = 1\npath = 5\nNAME = 'x'\n", ["_A, _B = (1, -3)"]),
        ("class Link:\n    MOST: ClassVar[int] = 3\n", ["MOST: ClassVar[int] = 3"]),
        ("class Color(IntEnum):\n    RED = 3\n", []),
        ("def look() -> None:\n    MOST = 3\n", ["MOST = 3"]),
        ("_SIZES = {'x': (1, 8), 'y': [2]}\n", ["_SIZES = {'x': (1, 8), 'y': [2]}"]),
        ("_SIZES = frozenset({3, 4})\n", ["_SIZES = frozenset({3, 4})"]),
        ("_LEVELS = {'x': 0, 'y': 1}\n_NAMES = {3: 'x'}\n", []),
        ("_POLL = 3  # noqa: S108\n", ["_POLL = 3"]),
        ("# -- limits ----\n_POLL = 3\n", ["_POLL = 3"]),
    ],
)
def test_what_explains_a_number(text: str, told: list[str]) -> None:
    assert unexplained(text) == told
