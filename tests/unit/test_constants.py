"""Numbers at the head of a module say why they have their value: beside them, above them or below them."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("riot_bus", "adapters", "dictionaries")
PLAIN = {"0", "1", "2"}
"""Numbers that are what they are."""


def unexplained(text: str) -> list[str]:
    """Return the numeric constants of a module that have no comment in their line or above them, and no text below.

    A text below a group of lines, without an empty line between them, explains all of these.
    """
    lines, body = text.splitlines(), ast.parse(text).body
    found = []
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
        above = body[first].lineno > 1 and lines[body[first].lineno - 2].startswith("#")
        beside = any("  # " in line for line in lines[node.lineno - 1 : end(node)])
        if not (explained or above or beside):
            found.append(ast.unparse(node))
    return found


def follows(one: ast.stmt, other: ast.stmt) -> bool:
    """Return whether two assignments stand in lines one after the other."""
    both = isinstance(one, ast.Assign | ast.AnnAssign) and isinstance(other, ast.Assign | ast.AnnAssign)
    return both and other.lineno == end(one) + 1


def end(node: ast.stmt) -> int:
    return node.end_lineno or node.lineno


def is_tuned(node: ast.Assign | ast.AnnAssign) -> bool:
    """Return whether constants get numbers other than 0, 1 and 2."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    names = [name for target in targets for name in (target.elts if isinstance(target, ast.Tuple) else [target])]
    if node.value is None or not all(isinstance(name, ast.Name) and name.id.strip("_").isupper() for name in names):
        return False
    values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
    return bool(values) and all(map(is_number, values)) and not {ast.unparse(value) for value in values} <= PLAIN


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
    ],
)
def test_what_explains_a_number(text: str, told: list[str]) -> None:
    assert unexplained(text) == told
