"""Each promise of SECURITY.md names tests, and they exist."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
TABLE = TEXT.partition("| from whom |")[2].partition("\n\n")[0]
PROMISES = [[cell.strip() for cell in line.split("|")[1:4]] for line in TABLE.splitlines()[2:]]


@cache
def names_in(file: str) -> set[str]:
    tree = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8"))
    return {each.name for each in tree.body if isinstance(each, ast.FunctionDef)}


def test_no_promise_stands_without_a_test_that_exists() -> None:
    assert len(PROMISES) > 20
    for _, promise, tests in PROMISES:
        named = [each.split("::") for each in re.findall(r"`([^`]+)`", tests)]
        assert named, promise
        for file, test in named:
            assert test in names_in(file), (promise, file, test)


def test_who_and_what_could_be_hostile_has_a_row() -> None:
    whom = ", ".join(row[0] for row in PROMISES)
    for one in (
        "finding",
        "rule",
        "baseline",
        "dictionary",
        "plan",
        "folder of logs",
        "wheel",
        "worker",
        "peer",
        "viewer",
    ):
        assert one in whom, one
