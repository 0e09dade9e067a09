"""Trials that narrow one threshold, for each kind of feature, against rules that are known."""

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from riot_bus.generalize.beam import Learnt
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.refine import around, decisive, probe_threshold, widen
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.rules import learn_from
from riot_bus.generalize.sampling import Assignment, Variable, columns_of
from riot_bus.generalize.table import Candidate, Table, concrete
from riot_bus.vocabulary.trial import Scalar

LONG, FLOAT = "int64", "float64"


def table_of(names: dict[str, Scalar], rows: Sequence[Assignment], fails: Callable[[Assignment], bool]) -> Table:
    kinds = {bool: "bool", int: LONG, float: FLOAT, str: "string"}
    table = Table([Variable(name, kinds[type(value)], value) for name, value in names.items()])
    table.add(rows, [fails(row) for row in rows])
    return table


def learnt(table: Table, *terms: Sequence[Candidate]) -> Learnt:
    return widen(table, Learnt(tuple(map(tuple, terms)), 0.0, 0))


def threshold(feature: Feature, operator: str, outside: Scalar, inside: Scalar) -> Candidate:
    return Candidate(feature, operator, 1.0, outside, inside)


def value_of(table: Table, feature: Feature, row: Assignment) -> float:
    values = feature.values(columns_of(table.variables, [row]))
    assert values is not None
    return values.tolist()[0]


def narrow(
    table: Table, candidate: Candidate, *others: Candidate, fails: Callable[[Assignment], bool], most: int = 400
) -> tuple[Candidate, int]:
    """Probe the threshold of a term until nothing is left to ask; each trial has to lie between the known values."""
    chance = random.Random(0)
    rest = Rule((tuple(map(concrete, others)),))
    for turn in range(most):
        rule = Learnt(((candidate, *others),), 0.0, 0)
        question = probe_threshold(table, rule, (0, 0), chance, turn=turn)
        if question is None:
            return candidate, turn
        value = value_of(table, candidate.feature, question)
        low, high = sorted((candidate.outside, candidate.inside))  # type: ignore[type-var]
        assert low < value < high  # type: ignore[operator]
        assert rest.predict(columns_of(table.variables, [question])).all()
        table.add([question], [fails(question)])
        candidate = replace(candidate, **{"inside" if fails(question) else "outside": value})
    return candidate, most


@pytest.mark.parametrize(
    ("kind", "limit"),
    [("mul", 4194304), ("mul", 1_000_003), ("add", 777), ("sub", -31), ("maxabs", 4000), ("minabs", 4000)],
)
@pytest.mark.parametrize("operator", ["<", ">"])
def test_thresholds_of_integers_become_exact(kind: str, limit: int, operator: str) -> None:
    feature = Feature(kind, ("x", "y"))
    literal = Literal(feature, operator, limit)
    rows: list[Assignment] = [{"x": x, "y": y} for x in (-90_000, -7, 3, 90_000) for y in (-80_000, 5, 80_000)]
    table = table_of({"x": 1, "y": 1}, rows, lambda row: False)

    def fails(row: Assignment) -> bool:
        return bool(literal.holds(columns_of(table.variables, [row]))[0])

    table = table_of({"x": 1, "y": 1}, rows, fails)
    values = [value_of(table, feature, row) for row in rows]
    inner = [value for value, row in zip(values, rows, strict=True) if fails(row)]
    outer = [value for value, row in zip(values, rows, strict=True) if not fails(row)]
    ends = (max(outer), min(inner)) if operator == ">" else (min(outer), max(inner))
    found, trials = narrow(table, threshold(feature, operator, *ends), fails=fails)
    assert trials < 120
    assert (found.outside, found.inside) == (limit, limit + (1 if operator == ">" else -1))


@pytest.mark.parametrize("kind", ["mul", "add", "sub", "div", "hypot", "maxabs", "minabs"])
def test_thresholds_of_floats_are_narrowed(kind: str) -> None:
    feature = Feature(kind, ("x", "y"))
    literal = Literal(feature, ">", 3.5)
    rows: list[Assignment] = [{"x": x, "y": y} for x in (-50.0, 0.5, 60.0) for y in (0.25, 1.0, 40.0)]
    table = table_of({"x": 1.0, "y": 1.0}, rows, lambda row: False)

    def fails(row: Assignment) -> bool:
        return bool(literal.holds(columns_of(table.variables, [row]))[0])

    table = table_of({"x": 1.0, "y": 1.0}, rows, fails)
    values = [value_of(table, feature, row) for row in rows]
    inside = min(value for value, row in zip(values, rows, strict=True) if fails(row))
    outside = max(value for value, row in zip(values, rows, strict=True) if not fails(row))
    found, _ = narrow(table, threshold(feature, ">", outside, inside), fails=fails, most=60)
    assert isinstance(found.outside, float)
    assert isinstance(found.inside, float)
    assert found.outside <= 3.5 < found.inside
    assert found.inside - found.outside < 1e-3


def test_a_sum_that_wraps_is_narrowed() -> None:
    feature = Feature("wrap8", ("x", "y"))
    table = Table([Variable("x", "uint8", 1), Variable("y", "uint8", 1)])

    def fails(row: Assignment) -> bool:
        return value_of(table, feature, row) > 77

    rows: list[Assignment] = [{"x": 3, "y": 2}, {"x": 100, "y": 100}, {"x": 255, "y": 2}]
    table.add(rows, [fails(row) for row in rows])
    found, _ = narrow(table, threshold(feature, ">", 5, 200), fails=fails)
    assert concrete(found).text() == "(x + y) % 256 > 77"


def test_the_rest_of_the_term_holds_in_a_probe_and_other_terms_do_not() -> None:
    def fails(row: Assignment) -> bool:
        x, y = row["x"], row["y"]
        assert isinstance(x, int)
        assert isinstance(y, int)
        return (x > 500 and row["on"] is True) or y > 1000

    rows: list[Assignment] = [
        {"x": x, "y": y, "on": on} for x in (0, 100, 900) for y in (0, 10, 2000) for on in (True, False)
    ]
    table = table_of({"x": 0, "y": 0, "on": True}, rows, fails)
    x, y, on = (Feature("raw", (name,)) for name in ("x", "y", "on"))
    rule = learnt(
        table,
        [threshold(x, ">", 100, 900), Candidate(on, "==", 1.0, inside=True)],
        [threshold(y, ">", 10, 2000)],
    )
    chance = random.Random(1)
    for turn in range(9):
        question = probe_threshold(table, rule, (0, 0), chance, turn=turn)
        assert question is not None
        assert question["on"] is True
        assert question["y"] in (0, 10)
    found, _ = narrow(table, *rule.terms[0], fails=fails)
    assert concrete(found).text() == "x > 500"


def test_values_that_are_no_numbers_are_stepped_over() -> None:
    rows: list[Assignment] = [{"x": x, "y": y} for x in (math.nan, math.inf, 0.0, 10.0) for y in (0.0, 2.0, math.nan)]
    feature = Feature("add", ("x", "y"))

    def fails(row: Assignment) -> bool:
        return row["x"] + row["y"] > 3.5  # type: ignore[operator]

    table = table_of({"x": 0.0, "y": 0.0}, rows, fails)
    found, _ = narrow(table, threshold(feature, ">", 2.0, 10.0), fails=fails, most=40)
    assert concrete(found).text() == "x + y > 3.5"


def test_what_has_no_threshold_or_an_exact_one_needs_no_trial() -> None:
    rows: list[Assignment] = [{"x": 4, "mode": "a"}, {"x": 5, "mode": "b"}]
    table = table_of({"x": 5, "mode": "b"}, rows, lambda row: row["mode"] == "b")
    x, mode = Feature("raw", ("x",)), Feature("raw", ("mode",))
    chance = random.Random(0)
    for candidate in (Candidate(mode, "==", 1.0, inside="b"), threshold(x, ">", 4, 5)):
        rule = learnt(table, [candidate])
        assert rule.terms == ((candidate,),)
        assert probe_threshold(table, rule, (0, 0), chance, turn=0) is None


def test_no_trial_is_made_where_the_rest_of_the_term_never_held() -> None:
    rows: list[Assignment] = [{"x": 4, "y": 0}, {"x": 90, "y": 0}]
    table = table_of({"x": 90, "y": 0}, rows, lambda row: row["x"] == 90)
    never = threshold(Feature("raw", ("y",)), ">", 5, 6)
    rule = learnt(table, [threshold(Feature("raw", ("x",)), ">", 4, 90), never])
    assert rule.terms[0][0] == threshold(Feature("raw", ("x",)), ">", 4, 90)
    assert probe_threshold(table, rule, (0, 0), random.Random(0), turn=0) is None


def test_an_interval_ends_at_samples_that_this_literal_alone_decides_about() -> None:
    rows: list[Assignment] = [
        {"x": 10, "on": True},
        {"x": 60, "on": False},  # passes for another reason
        {"x": 90, "on": True},
        {"x": 400, "on": True},
    ]
    table = table_of({"x": 400, "on": True}, rows, lambda row: row["on"] is True and row["x"] > 20)  # type: ignore[operator]
    on = Candidate(Feature("raw", ("on",)), "==", 1.0, inside=True)
    rule = learnt(table, [threshold(Feature("raw", ("x",)), ">", 60, 90), on])
    assert (rule.terms[0][0].outside, rule.terms[0][0].inside) == (10, 90)
    assert concrete(rule.terms[0][0]).operator in (">", ">=")


def test_a_literal_that_decides_nothing_is_left_out_and_a_size_that_is_no_matter_of_sign_is_plain() -> None:
    rows: list[Assignment] = [{"x": x, "y": y} for x in (-5000, 50, 150, 900, 5000) for y in (0, 10)]
    table = table_of({"x": 150, "y": 10}, rows, lambda row: 100 < int(str(row["x"])) < 1000)
    size = threshold(Feature("abs", ("x",)), "<", 5000, 900)
    idle = threshold(Feature("raw", ("y",)), ">", -20, 0)
    found = widen(table, learnt(table, [threshold(Feature("raw", ("x",)), ">", 50, 150), size, idle]))
    assert {candidate.feature for term in found.terms for candidate in term} == {Feature("raw", ("x",))}
    assert [candidate.operator for candidate in found.terms[0]] == [">", "<"]


@pytest.mark.parametrize("seed", range(40))
def test_a_rule_says_of_the_samples_what_the_learner_counted(seed: int) -> None:
    """Thresholds that are found where another literal holds must not let in samples for which it does not."""
    chance = random.Random(seed)
    limit = 10 ** chance.uniform(0, 8)

    def fails(row: Assignment) -> bool:
        return row["m"] == 1 and row["on"] is True and not row["x"] <= limit  # type: ignore[operator]

    def size() -> float:
        large = 10.0 ** chance.uniform(0, 12) * chance.choice((1, 1, 1, -1))
        return chance.choice((chance.uniform(-15, 15), large, math.nan, 0.0))

    rows: list[Assignment] = [
        {"x": size(), "m": chance.choice((0, 1, 1, 2, 3)), "on": chance.random() < 0.8}
        for _ in range(chance.choice((20, 60, 150)))
    ]
    table = table_of({"x": 1e7, "m": 1, "on": True}, rows, fails)
    found, _, _ = learn_from(table)
    said = found.rule.predict(columns_of(table.variables, rows))
    assert int((said != np.array(table.failed)).sum()) == found.mistakes


def test_a_rule_depends_on_what_alone_supports_it_and_on_what_lies_next_to_its_limit() -> None:
    high, mode = Literal(Feature("raw", ("x",)), ">", 100.0), Literal(Feature("raw", ("mode",)), "==", 2)
    low = Literal(Feature("raw", ("x",)), "<", -5.0)
    values = [(120.0, 2), (130.0, 2), (140.0, 2), (150.0, 2), (160.0, 1), (90.0, 2), (50.0, 2), (-9.0, 2), (0.0, 2)]
    values += [(10.0, 2)]
    columns = {"x": np.array([x for x, _ in values]), "mode": np.array([number for _, number in values])}
    failed = np.array([True, True, True, True, False, False, False, True, False, False])
    # Of the failing ones, -9 alone has its term; 160 alone shows that the mode matters; 0, 90 and 160 are nearest.
    assert sorted(decisive(Rule(((high, mode), (low,))), columns, failed)) == [4, 5, 7, 8]


def test_a_threshold_is_tried_with_other_variables_such_as_the_rest_of_its_term_needs() -> None:
    """Each y needs an h of its own for y + h to wrap around."""
    y, total = Feature("raw", ("y",)), Feature("wrap32", ("y", "h"))

    def fails(row: Assignment) -> bool:
        return int(row["y"]) > 480 and (int(row["y"]) + int(row["h"])) % 2**32 <= 480  # type: ignore[arg-type]

    rows: list[Assignment] = [{"y": 2**32 - 1, "h": 240}, {"y": 100, "h": 240}, {"y": 2**32 - 200, "h": 100}]
    table = Table([Variable(name, "uint32", 240) for name in ("y", "h")])
    table.add(rows, [fails(row) for row in rows])
    rule = Learnt(((threshold(y, ">", 100, 2**32 - 1), threshold(total, "<", 2**32 - 100, 239)),), 0.0, 0)
    probe = probe_threshold(table, rule, (0, 0), random.Random(0), turn=0)
    assert probe is not None
    assert 100 < int(probe["y"]) < 2**32 - 1  # type: ignore[arg-type]
    assert (int(probe["y"]) + int(probe["h"])) % 2**32 <= 480  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("members", "also"),
    [((0, 1, 2, 4), {-1, 3, 5, 8}), ((1, 2, 4, 8), {0, 3, 16}), ((3,), {2, 4, 5, 6}), ((300, 4), {600, 8})],
)
def test_what_an_enumeration_may_go_on_with_is_tried(members: tuple[int, ...], also: set[int]) -> None:
    found = around(members)
    assert also <= set(found)
    assert not set(found) & set(members)
    assert len(found) == len(set(found)) <= 40
