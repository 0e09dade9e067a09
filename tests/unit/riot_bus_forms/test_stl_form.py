"""Formulas are violated exactly where the rule holds."""

from __future__ import annotations

import itertools

import pytest

from riot_bus.generalize.features import FEATURE_KINDS, FLAGS, Feature
from riot_bus.generalize.forms.tree import OPERATIONS as ALL
from riot_bus.generalize.forms.tree import feature_tree
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.monitors.model import judge
from riot_bus_forms.stl_form import OPERATIONS, NoFormulaError, stl_formula
from riot_bus_forms.temporal import Stl
from riot_bus_testkit.monitors import trial_view
from tests.rule_rows import columns, feature_of, operations, takes_texts
from tests.stl_env import need_rtamt

NAMES = ["a:i32", "a:f64", "a:flag"]
ROWS = [[x, y, x > 0] for x in (-9, 0, 3, 4) for y in (-7.25, 1.625, 12.0)]


def test_each_operation_has_a_form_or_none() -> None:
    assert {*OPERATIONS, "variable", "constant"} == set(ALL)


def test_the_paper_s_rule() -> None:
    product = Feature("mul", ("/map_updates:x", "/map_updates:y"))
    terms = ((Literal(product, "<", 0),), (Literal(product, ">", 4194304),))
    x, y = "map_updates_x", "map_updates_y"
    formula, signals = stl_formula(terms, types=dict.fromkeys(("/map_updates:x", "/map_updates:y"), "int32"))
    assert formula == f"always (not ((({x} * {y}) < (0 - 0.5)) or (({x} * {y}) > 4194304.5)))"
    assert signals == {x: "/map_updates:x", y: "/map_updates:y"}


@pytest.mark.parametrize("kind", sorted(FEATURE_KINDS))
def test_it_is_violated_exactly_where_the_rule_holds(kind: str) -> None:
    need_rtamt()
    types = {"a:i32": "int32", "a:f64": "float64", "a:flag": "bool", "a:mode": "string"}
    feature, flag = feature_of(kind, ("a:mode",) if takes_texts(kind) else tuple(types)), kind in FLAGS
    names = feature.args
    compared = [("is", None)] if flag else itertools.product(("<", "<=", ">", ">=", "=="), (-3, 2.25))
    rules = [Rule(((Literal(feature, operator, value),),)) for operator, value in compared]
    told = 0
    for rule in rules:
        try:
            formula, signals = stl_formula(rule.terms, types={name: types[name] for name in names})
        except NoFormulaError:
            continue
        told += 1
        for row in ROWS:
            said = bool(rule.predict(columns([row], NAMES))[0])
            values = {"i32": row[0], "f64": row[1], "flag": row[2]}
            found = judge(trial_view([("a", values), ("a", values)]), [Stl(formula, signals)])
            if row[0] != 0 or kind != "div":
                assert bool(found.violations) is said, (formula, row)
    used = operations(feature_tree(feature)) - {"variable", "constant"}
    assert told or any(OPERATIONS[each] is None for each in used)


@pytest.mark.parametrize("literal", [Literal(Feature("raw", ("a:flag",)), each, True) for each in ("==", "!=")])
def test_flags_are_signals_too(literal: Literal) -> None:
    need_rtamt()
    formula, signals = stl_formula(((literal,),), types={"a:flag": "bool"})
    for value in (False, True):
        found = judge(trial_view([("a", {"flag": value})] * 2), [Stl(formula, signals)])
        assert bool(found.violations) is (value == (literal.operator == "=="))


@pytest.mark.parametrize(
    ("literal", "why"),
    [
        (Literal(Feature("raw", ("a:mode",)), "==", "auto"), "signals are numbers"),
        (Literal(Feature("nan", ("a:f64",)), "is"), "no such operation"),
        (Literal(Feature("wrap8", ("a:i32", "a:f64")), ">", 3), "no such operation"),
        (Literal(Feature("raw", ("a:f64",)), "==", 3), "at a limit itself"),
        (Literal(Feature("prefix", ("a:mode",), "x"), "is"), "no such operation"),
        (Literal(Feature("raw", ("a:mode",)), "in", ("x", "y")), "signals are numbers"),
        (Literal(Feature("raw", ("a:i32",)), "==", 2.5), "is never so"),
    ],
)
def test_what_it_cannot_say_is_told(literal: Literal, why: str) -> None:
    types = {"a:mode": "string", "a:f64": "float64", "a:i32": "int32"}
    with pytest.raises(NoFormulaError, match=why):
        stl_formula(((literal,),), types={name: types[name] for name in literal.feature.args})
