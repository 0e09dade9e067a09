"""Generated Python files run on their own, and say of any row what the rule does."""

from __future__ import annotations

import ast
import itertools
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riot_bus.generalize.features import Feature
from riot_bus.generalize.forms.repair import Repair, why_not_repairable
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus_forms.python_file import python_file
from tests.rule_rows import TYPES, columns, every_rule, rows

SCALE = {"a:i8": 3.0, "a:f64": 0.5}


def text_of(rule: Rule, types: Mapping[str, str] = TYPES) -> str:
    return python_file(
        rule.terms, types={name: types[name] for name in rule.variables}, scale=SCALE, told=["a rule", rule.text()]
    )


def same(left: Any, right: Any) -> bool:
    return left == right or (left != left and right != right)


def agree(rule: Rule, table: list[list[Any]]) -> int:
    space: dict[str, Any] = {"__name__": "sanitize"}
    exec(compile(text_of(rule), "sanitize.py", "exec"), space)
    names, said = rule.variables, rule.predict(columns(table))
    repair = Repair(rule.terms, names, movable=names, types=TYPES, scale=SCALE)
    assert ("sanitize" in space) == (why_not_repairable(rule.terms, names, TYPES) == "")
    moved = 0
    for row, wanted in zip(table, said.tolist(), strict=True):
        values = [row[list(TYPES).index(name)] for name in names]
        assert space["is_dangerous"](*values) is wanted, (rule.text(), values)
        if "sanitize" in space:
            found, expected = space["sanitize"](*values), repair(values)
            assert (found is None) == (expected is None)
            assert all(map(same, found or (), expected or ())), (rule.text(), values)
            if found is not None and wanted:
                moved += 1
                assert not space["is_dangerous"](*found)
    return moved


def test_it_agrees_with_the_rule() -> None:
    table = rows(30, seed=5)
    assert sum(agree(rule, table) for rule in itertools.islice(every_rule(size=2), 0, None, 3)) > 100


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_every_literal_agrees() -> None:
    for number, rule in enumerate(every_rule(size=2)):
        agree(rule, rows(200, seed=number))


PAPER = Feature("mul", ("/map_updates:x", "/map_updates:y"))


def test_it_reads_like_the_rule(tmp_path: Path) -> None:
    rule = Rule(((Literal(PAPER, "<", 0),), (Literal(PAPER, ">", 4194304),)))
    text = text_of(rule, {"/map_updates:x": "int32", "/map_updates:y": "int32"})
    assert "(map_updates_x * map_updates_y < 0)\n        or (map_updates_x * map_updates_y > 4194304)" in text
    (tmp_path / "sanitize.py").write_text(text)
    code = "import sanitize, sys; print(sanitize.sanitize(-3, 700), 'riot_bus' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, '.'); {code}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.stdout == "[0, 700] False\n", done.stderr


HOSTILE = 'x"""\n\\N{BULLET}\'\u2028import os #\\'


def test_names_of_others_stay_text() -> None:
    terms = ((Literal(Feature("raw", (HOSTILE,)), ">", 3),), (Literal(Feature("raw", ("def",)), "==", HOSTILE),))
    text = python_file(terms, types={HOSTILE: "int8", "def": "string"}, scale={}, told=[HOSTILE, "\\"])
    tree = ast.parse(text)
    plain = ast.parse(
        text_of(Rule(((Literal(PAPER, "<", 0),),)), {"/map_updates:x": "int32", "/map_updates:y": "int32"})
    )
    imports = [ast.dump(each) for each in ast.walk(tree) if isinstance(each, ast.Import | ast.ImportFrom)]
    assert imports == [ast.dump(each) for each in ast.walk(plain) if isinstance(each, ast.Import | ast.ImportFrom)]
    space: dict[str, Any] = {}
    exec(compile(tree, "x", "exec"), space)
    assert space["is_dangerous"](1, HOSTILE)
    assert not space["is_dangerous"](1, "")


def test_what_has_no_nearest_values_has_no_sanitize() -> None:
    rule = Rule(((Literal(Feature("nan", ("a:f64",)), "is"),),))
    text = text_of(rule)
    assert "def sanitize" not in text
    assert "# No sanitize: \"'isnan(a:f64)' has no nearest value for which it is false: what is not a number" in text
    assert np.isnan([each[list(TYPES).index("a:f64")] for each in rows(300, seed=1)]).any()
