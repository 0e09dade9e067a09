"""The predicate says of any row what the rule does, on its own."""

from __future__ import annotations

from typing import Any

import pytest

from riot_bus.generalize.features import Feature
from riot_bus.generalize.forms.python_form import OPERATIONS, python_predicate
from riot_bus.generalize.forms.tree import OPERATIONS as ALL
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from tests.rule_rows import TYPES, columns, every_rule, rows


def test_each_operation_has_a_form() -> None:
    assert {*OPERATIONS, "variable", "constant"} == set(ALL)


def test_the_predicate_of_rule_json_stands_alone_and_says_what_the_rule_does() -> None:
    table = rows(80, seed=9)
    given = columns(table)
    for rule in every_rule(size=4):
        space: dict[str, Any] = {}
        exec(python_predicate(rule.terms, types=TYPES, told=rule.text()), space)
        said = [space["rule"](dict(zip(TYPES, row, strict=True))) for row in table]
        assert said == rule.predict(given).tolist(), rule.text()


@pytest.mark.parametrize("terms", [(), ((),)])
def test_the_predicate_of_never_and_always(terms: tuple[tuple[Literal, ...], ...]) -> None:
    space: dict[str, Any] = {}
    exec(python_predicate(terms, types={}, told=Rule(terms).text()), space)
    assert space["rule"]({}) is bool(terms)


def test_names_of_others_are_no_code_in_the_predicate() -> None:
    hostile = "a'] or print(1) #\n"
    rule = Rule(((Literal(Feature("raw", (hostile,)), "==", '"""\n'),),))
    space: dict[str, Any] = {}
    exec(python_predicate(rule.terms, types={hostile: "string"}, told=rule.text()), space)
    assert space["rule"]({hostile: '"""\n'})
