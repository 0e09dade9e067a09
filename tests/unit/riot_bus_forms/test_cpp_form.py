"""Generated C++ compiles without a warning, and says of any row what the rule does."""

from __future__ import annotations

import itertools
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riot_bus.generalize.features import FEATURE_KINDS, Feature
from riot_bus.generalize.forms.repair import Repair, why_not_repairable
from riot_bus.generalize.forms.tree import OPERATIONS as ALL
from riot_bus.generalize.forms.tree import ROOTS
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_forms.cpp_form import OPERATIONS, cpp_file
from tests.cpp_rows import Output, needs_compiler, packed, program
from tests.rule_rows import TYPES, columns, every_literal, every_rule, rows, takes_texts

SCALE = {"a:i8": 3.0, "a:f64": 0.5}
pytestmark = pytest.mark.timeout(1800)


def header(rule: Rule, name: str, told: Sequence[str] = ()) -> tuple[str, list[str], bool]:
    types = {each: TYPES[each] for each in rule.variables}
    text = cpp_file(rule.terms, types=types, scale=SCALE, name=name, told=told)
    return text, list(types), not why_not_repairable(rule.terms, list(types), types)


def has_form(literal: Literal) -> bool:
    """Return whether C++ has a form of a literal; what it has none of is told, never written wrongly."""
    try:
        header(Rule(((literal,),)), "one")
    except ConfigError:
        return False
    return True


def same(left: Any, right: Any) -> bool:
    return left == right or (left != left and right != right)


def agree(rules: Sequence[Rule], table: list[list[Any]], folder: Path) -> int:
    """Compare the number of terms that hold, and the sanitised values; return how many values were moved."""
    headers = {f"rule{number}": header(rule, f"rule{number}") for number, rule in enumerate(rules)}
    judge, moved, place = program(folder, headers), 0, {name: number for number, name in enumerate(TYPES)}
    done = subprocess.run([judge], input=packed(table), capture_output=True, check=True, timeout=800)
    output, given = Output(done.stdout), columns(table)
    held = [sum(Rule((term,)).predict(given).astype(np.int64) for term in rule.terms) for rule in rules]
    repairs = [
        Repair(rule.terms, names, movable=names, types=TYPES, scale=SCALE) if sanitises else None
        for rule, (_, names, sanitises) in zip(rules, headers.values(), strict=True)
    ]
    for index, row in enumerate(table):
        for number, (rule, (_, names, _)) in enumerate(zip(rules, headers.values(), strict=True)):
            assert output.take("B") == held[number][index], (rule.text(), row)
            repair = repairs[number]
            if repair is not None:
                found = [output.value(TYPES[name]) for name in names] if output.take("?") else None
                wanted = repair([row[place[name]] for name in names])
                assert (found is None) == (wanted is None), (rule.text(), row, found, wanted)
                assert all(map(same, found or (), wanted or ())), (rule.text(), row, found, wanted)
                moved += found is not None and held[number][index] > 0
    assert output.left == 0
    return moved


def test_each_operation_has_a_form() -> None:
    assert {*OPERATIONS, "variable", "constant"} == set(ALL)


def test_it_agrees_with_the_rule(tmp_path: Path) -> None:
    needs_compiler()
    by_kind: dict[str, list[Literal]] = {}
    for literal in filter(has_form, every_literal()):
        by_kind.setdefault(literal.feature.kind, []).append(literal)
    few = {kind: literals[5 :: max(1, len(literals) // 3)][:3] for kind, literals in by_kind.items()}
    single = [Rule(((literals[0],),)) for kind, literals in few.items() if kind in ROOTS]
    rest = [
        Rule(tuple((each,) for literals in list(few.values())[start::3] for each in literals)) for start in range(3)
    ]
    rules = [*single, *rest]
    assert agree(rules, rows(400, seed=11), tmp_path) > 50


@pytest.mark.nightly
def test_it_agrees_with_the_rule_on_a_million_rows(tmp_path: Path) -> None:
    needs_compiler()
    written = (rule for rule in every_rule(size=9) if all(has_form(one) for term in rule.terms for one in term))
    rules = list(itertools.islice(written, 5, 60, 9))
    headers = {f"rule{number}": (*header(rule, f"rule{number}")[:2], False) for number, rule in enumerate(rules)}
    judge, held = program(tmp_path, headers), 0
    for seed in range(20):
        table = rows(50_000, seed=seed)
        done = subprocess.run([judge], input=packed(table), capture_output=True, check=True, timeout=800)
        found, given = np.frombuffer(done.stdout, np.uint8).reshape(len(table), len(rules)), columns(table)
        for number, rule in enumerate(rules):
            wanted = sum(Rule((term,)).predict(given).astype(np.uint8) for term in rule.terms)
            assert (found[:, number] == wanted).all(), (rule.text(), table[int((found[:, number] != wanted).argmax())])
            held += int((wanted > 0).sum())
    assert 0 < held < 20 * 50_000 * len(rules)


@pytest.mark.nightly
def test_every_literal_agrees(tmp_path: Path) -> None:
    needs_compiler()
    every = [rule for rule in every_rule(size=9) if all(has_form(one) for term in rule.terms for one in term)]
    for start in range(0, len(every), 24):
        folder = tmp_path / str(start)
        folder.mkdir()
        agree(every[start : start + 24], rows(200, seed=start), folder)


def test_it_is_plain_where_numbers_are_small() -> None:
    product = Feature("mul", ("a:i32", "a:i32"))
    text, _, _ = header(Rule(((Literal(product, ">", 4194304),),)), "riot_paper")
    assert "int(Integer(v.a_i32) * Integer(v.a_i32) > 4194304)" in text.replace("((", "(").replace("))", ")")
    assert "__int128" not in text


HOSTILE = 'x"\\\n#include "/etc/passwd"\n*/ ??/\n\u2028 \\'


def test_names_of_others_stay_text(tmp_path: Path) -> None:
    needs_compiler()
    terms = ((Literal(Feature("raw", (HOSTILE,)), ">", 3),), (Literal(Feature("raw", ("int",)), "==", HOSTILE),))
    text = cpp_file(terms, types={HOSTILE: "int8", "int": "string"}, scale={}, name="hostile", told=[HOSTILE, "\\"])
    (tmp_path / "a.cpp").write_text(text.replace("#pragma once", "") + "int main() {}\n")
    command = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "a.cpp"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert sum(each.startswith("#include") for each in text.splitlines()) == 8


def test_texts_and_what_is_too_large_have_no_form_and_all_else_has() -> None:
    without = {literal.feature.kind for literal in every_literal() if not has_form(literal)}
    wrapping = ("wrap", "wrapsub", "wrapmul", "signed", "signedsub", "signedmul")
    large = {"mul", "mul3", "mulsub", "linear", *(f"{kind}{bits}" for kind in wrapping for bits in (8, 16, 32, 64))}
    assert without <= {kind for kind in FEATURE_KINDS if takes_texts(kind)} | large
    assert not {"mul", "linear", "wrap8", "signedmul32", "mod", "bits"} - {
        literal.feature.kind for literal in every_literal() if has_form(literal)
    }


def test_what_c_plus_plus_has_no_integers_for_is_refused() -> None:
    product = Feature("mul", ("a:u64", "a:u64"))
    with pytest.raises(ConfigError, match="127 bits"):
        header(Rule(((Literal(product, ">", 2**127),),)), "large")
