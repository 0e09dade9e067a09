import math

import numpy as np
import pytest

from riot_bus.generalize.expressions import TEXTS
from riot_bus.generalize.features import Feature
from riot_bus.generalize.forms.function import OPERATIONS, judge_of
from riot_bus.generalize.forms.tree import OPERATIONS as ALL
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from tests.rule_rows import TYPES, columns, every_rule, rows


def test_each_operation_is_carried_out() -> None:
    assert {*OPERATIONS, *TEXTS, "variable", "constant"} == set(ALL)


def test_it_says_of_each_row_what_the_rule_does() -> None:
    names, table = list(TYPES), rows(60, seed=3)
    for rule in every_rule(size=3):
        judge = judge_of(rule.terms, names)
        said = [judge(row) for row in table]
        assert said == rule.predict(columns(table)).tolist(), rule.text()


ODD = ["text", b"bytes", None, True, 3, 2.5, math.nan, math.inf, -(2**70)]


@pytest.mark.parametrize("value", ODD)
def test_values_of_other_types_and_sizes(value: object) -> None:
    for rule in every_rule(size=1):
        names = rule.variables
        row = [value, 3, 3, 3][: len(names)]
        said = judge_of(rule.terms, names)(row)
        table = {name: np.array([each], dtype=object) for name, each in zip(names, row, strict=True)}
        assert [said] == rule.predict(table).tolist(), rule.text()


def test_no_integer_is_too_large() -> None:
    rule = Rule(((Literal(Feature("hypot", ("x", "y")), ">", 5),), (Literal(Feature("mul", ("x", "y")), "<", 0.5),)))
    judge = judge_of(rule.terms, ["x", "y"])
    assert judge([10**400, 1.5])
    assert judge([-(10**400), 1.5])
    assert judge([2, 0.0])


def test_never_and_always() -> None:
    assert not judge_of((), [])([])
    assert judge_of(((),), [])([])
