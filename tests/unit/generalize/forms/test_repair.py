import math
import random
import re
from collections.abc import Sequence

import pytest

from riot_bus.generalize.features import Feature
from riot_bus.generalize.forms.function import judge_of
from riot_bus.generalize.forms.repair import Repair, unit_of, why_not_repairable
from riot_bus.generalize.forms.tree import ROOTS
from riot_bus.generalize.literals import Literal
from tests.rule_rows import feature_of, rows

Terms = tuple[tuple[Literal, ...], ...]
X, Y, Z = NAMES = ["x", "y", "z"]


def raw(name: str, operator: str, value: object) -> Literal:
    return Literal(Feature("raw", (name,)), operator, value)  # type: ignore[arg-type]


def make(terms: Terms, type_: str = "int8", **scale: float) -> Repair:
    return Repair(terms, NAMES, movable=NAMES, types=dict.fromkeys(NAMES, type_), scale=scale)


PRODUCT = Feature("mul", (X, Y))
PAPER = ((Literal(PRODUCT, "<", 0),), (Literal(PRODUCT, ">", 4194304),))


def test_the_paper_s_rule() -> None:
    repair = make(PAPER, "int32")
    assert repair([-3, 700, 0]) == [0, 700, 0]
    assert repair([4097, 1024, 0]) == [4096, 1024, 0]
    most = 2**31 - 1
    assert repair([most, most, 0]) in ([0, most, 0], [most, 0, 0])


def _all_moves(values: list[int], terms: Terms) -> float:
    judge = judge_of(terms, NAMES)
    moves = [[*values[:n], other, *values[n + 1 :]] for n in range(3) for other in range(-128, 128)]
    return min((far(move, values) for move in moves if not judge(move)), default=math.inf)


def far(left: Sequence[int], right: Sequence[int]) -> int:
    return sum(abs(a - b) for a, b in zip(left, right, strict=True))


@pytest.mark.parametrize("kind", sorted(ROOTS))
def test_no_single_value_that_is_nearer_would_do(kind: str) -> None:
    rng = random.Random(1)
    tried = 0
    for _ in range(150):
        literals = [
            Literal(
                feature_of(kind, NAMES),
                rng.choice(["<", "<=", ">", ">=", "==", "!="]),
                rng.choice([rng.randint(-99, 99), 2.5]),
            )
            for _ in range(2)
        ]
        terms = ((literals[0],), (literals[1], raw(Y, ">", rng.randint(-9, 9))))
        values = [rng.randint(-128, 127) for _ in NAMES]
        if not judge_of(terms, NAMES)(values):
            continue
        tried += 1
        found, nearest = make(terms)(values), _all_moves(values, terms)
        if nearest == math.inf:
            continue
        assert found is not None
        assert far(found, values) == nearest, (terms, values)
    assert tried > 20


@pytest.mark.parametrize("type_", ["float64", "float32", "int64", "uint64", "uint8"])
@pytest.mark.parametrize("kind", sorted(ROOTS))
def test_what_it_returns_is_safe_and_fits(kind: str, type_: str) -> None:
    variable = {"float64": "a:f64", "float32": "a:f32", "int64": "a:i64", "uint64": "a:u64", "uint8": "a:u8"}[type_]
    table = rows(60, seed=4, names=[variable] * 3)
    found = 0
    for operator, value in ((">", 2.5), ("<", -3), (">=", 1e6), ("==", 7), ("!=", 4)):
        terms = ((Literal(feature_of(kind, NAMES), operator, value),),)
        judge = judge_of(terms, NAMES)
        for row in table:
            if judge(row):
                mended = make(terms, type_)(row)
                if mended is not None:
                    found += 1
                    assert not judge(mended)
                    assert all(type(new) is type(old) for new, old in zip(mended, row, strict=True))
    assert found > 20


def test_a_float_moves_to_the_threshold_itself() -> None:
    repair = make(((raw(X, ">", 2.5),),), "float64")
    assert repair([7.0, 0.0, 0.0]) == [2.5, 0.0, 0.0]
    assert make(((raw(X, ">=", 2.5),),), "float64")([7.0, 0.0, 0.0]) == [math.nextafter(2.5, 0), 0.0, 0.0]
    assert make(((raw(X, ">=", 2.5),),), "float32")([7.0, 0.0, 0.0]) == [2.5 - 2**-22, 0.0, 0.0]


def test_two_values_move_where_one_will_not_do() -> None:
    terms = ((raw(X, ">", 5),), (raw(Y, ">", 7),))
    assert make(terms)([9, 9, 0]) == [5, 7, 0]


def test_the_scale_says_which_value_moves() -> None:
    assert make(((Literal(Feature("add", (X, Y)), ">", 10),),), x=1.0, y=100.0)([8, 8, 0]) == [8, 2, 0]


@pytest.mark.parametrize("spread", [0.0, -1.0, math.inf, math.nan])
def test_a_spread_that_is_none_counts_as_one(spread: float) -> None:
    assert unit_of({X: spread, Y: 2.5}, X) == 1.0
    assert unit_of({X: spread, Y: 2.5}, Y) == 2.5


def test_where_nothing_helps_it_says_so() -> None:
    assert make(((raw(X, ">", -200),),))([3, 3, 3]) is None  # no int8 is that low


@pytest.mark.parametrize(
    ("terms", "why"),
    [
        (((Literal(Feature("nan", (X,)), "is"),), (raw(X, ">", 5),)), "'isnan\\(x\\)' .* not a number"),
        (((Literal(Feature("wrap8", (X, Y)), ">", 5),),), "what wraps around"),
        (((raw("mode", "==", "auto"),),), "no nearest value"),
        (((),), "'always'"),
    ],
)
def test_what_cannot_be_repaired_is_said(terms: Terms, why: str) -> None:
    types = {X: "float64", Y: "float64", "mode": "string"}
    assert re.search(why, why_not_repairable(terms, [X, Y, "mode"], types))


def test_one_literal_of_a_term_is_enough() -> None:
    terms = ((raw("mode", "==", "auto"), raw(X, ">", 5)),)
    types = {X: "int8", "mode": "string"}
    assert why_not_repairable(terms, ["mode", X], types) == ""
    assert why_not_repairable(terms, ["mode"], types) != ""
    repair = Repair(terms, ["mode", X], movable=["mode", X], types=types, scale={})
    assert repair(["auto", 9]) == ["auto", 5]
