"""Arrays as variables of a rule."""

from __future__ import annotations

import math
import random

from riot_bus.generalize.arrays import columns_of_array, drawn_elements, known_elements, with_column
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rules import Variable, learn_rule
from riot_bus.generalize.sampling import Sampler, changed, columns_of, fit, row_of, scalars_of
from riot_bus.vocabulary.elements import Elements

RANGES = Variable(
    "/scan:ranges[*]",
    "float64[]",
    Elements([1.0, 500.0, 2.0]),
    passing=(Elements([1.0, 3.0, 2.0]),),
    nominal=(Elements([4.0, 3.0, 2.0]), Elements([1.0, 3.0, 2.0])),
    dictionary=(math.nan, 1e6),
    places=(1,),
)


def test_what_rules_see_of_an_array() -> None:
    names = [name for name, _, _ in RANGES.columns]
    assert names == [
        "/scan:max(ranges[*])", "/scan:min(ranges[*])", "/scan:isnan(ranges[*])", "/scan:nonfinite(ranges[*])",
        "/scan:ranges[1]",
    ]  # fmt: skip
    row = row_of([RANGES], {RANGES.name: Elements([7.0, math.nan, 2.0])})
    assert list(row.values())[:4] == [7.0, 2.0, True, True]
    assert [one.type for one in scalars_of([RANGES])] == ["float64", "float64", "bool", "bool", "float64"]
    assert [name for name, _, _ in columns_of_array("n[*]", "uint8", ())] == ["max(n[*])", "min(n[*])"]
    columns = columns_of([RANGES], [{RANGES.name: RANGES.failing}, {RANGES.name: RANGES.passing[0]}])
    assert columns["/scan:max(ranges[*])"].tolist() == [500.0, 3.0]
    assert columns["/scan:isnan(ranges[*])"].dtype == bool


def test_a_column_is_given_a_value() -> None:
    base = {RANGES.name: Elements([1.0, 500.0, 2.0]), "n": 3}
    variables = [RANGES, Variable("n", "int8", 3)]

    def moved(name: str, value: float) -> object:
        found = changed(variables, base, {name: value})
        return found and found[RANGES.name]

    assert moved("/scan:max(ranges[*])", 1.5) == (1.0, 1.5, 1.5)
    assert moved("/scan:min(ranges[*])", 50.0) == (50.0, 500.0, 50.0)
    assert moved("/scan:ranges[1]", -1) == (1.0, -1.0, 2.0)
    assert changed(variables, base, {"n": 200}) is None
    assert changed(variables, base, {}) is None
    assert with_column(Elements([math.nan, math.nan]), "max(r[*])", None, 3.0)[0] == 3.0


def test_arrays_are_drawn_with_their_length() -> None:
    chance = random.Random(3)
    sampler = Sampler([RANGES])
    assert sampler.behind("/scan:ranges[1]") is RANGES
    drawn = [sampler.value(RANGES, chance) for _ in range(300)]
    assert {len(each) for each in (*drawn, *sampler.known[RANGES.name])} == {3}
    changes = {sum(a != b for a, b in zip(each, RANGES.nominal[0], strict=True)) for each in drawn}  # type: ignore[arg-type]
    assert changes == {0, 1, 2, 3}
    assert drawn_elements(Elements([1.0]), lambda: 2.0, chance) in ((1.0,), (2.0,))
    everywhere = known_elements(Elements([1, 2]), Elements([3, 4]), [9])
    assert [each.count(9) for each in everywhere] == [1, 1, 2]


def test_arrays_are_held_as_their_type_holds_them() -> None:
    assert fit(Elements([1, 2.5]), "float32[]") == (1.0, 2.5)
    assert fit(Elements([1, 300]), "uint8[]") is None
    assert fit(Elements([1]), "uint8") is None
    assert fit(3, "uint8[]") is None


def test_what_is_said_of_elements() -> None:
    def said(kind: str, operator: str, value: float | bool) -> str:
        return Literal(Feature("raw", (f"/scan:{kind}(ranges[*])",)), operator, value).text()

    assert said("max", ">", 100) == "any(/scan:ranges[*]) > 100"
    assert said("min", "<=", 0) == "any(/scan:ranges[*]) <= 0"
    assert said("max", "<", 0) == "all(/scan:ranges[*]) < 0"
    assert said("min", ">=", 5) == "all(/scan:ranges[*]) >= 5"
    assert said("max", "==", 5) == "max(/scan:ranges[*]) == 5"
    assert said("isnan", "==", True) == "any(/scan:ranges[*]) is NaN"
    assert said("nonfinite", "!=", True) == "none(/scan:ranges[*]) is not finite"
    apart = Literal(Feature("sub", ("/scan:max(r[*])", "/scan:min(r[*])")), ">", 5)
    assert apart.text() == "max(/scan:r[*]) - min(/scan:r[*]) > 5"


def test_one_element_is_told_from_any() -> None:
    def learnt(fails: object) -> str:
        assert callable(fails)
        return learn_rule(
            [RANGES], lambda asked: [bool(fails(each[RANGES.name])) for each in asked], seed=1, budget=60, validation=10
        ).rule.text()

    assert learnt(lambda ranges: any(one > 100 for one in ranges)) == "any(/scan:ranges[*]) > 100"
    assert learnt(lambda ranges: ranges[1] > 100) == "/scan:ranges[1] > 100"
