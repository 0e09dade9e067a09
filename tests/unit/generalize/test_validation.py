import random

import numpy as np
import pytest

from riot_bus.generalize.beam import Learnt
from riot_bus.generalize.features import Feature
from riot_bus.generalize.sampling import Sampler, Variable
from riot_bus.generalize.table import Candidate, Table
from riot_bus.generalize.validation import near_limits, scores


def test_scores_of_a_rule_without_a_mistake() -> None:
    told = scores([True] * 30 + [False] * 30, [True] * 30 + [False] * 30, 0.25)
    assert told.precision.rate == 1.0
    assert told.recall.rate == told.balanced_accuracy == 1.0
    assert told.precision.low == pytest.approx(0.8843, abs=1e-4)
    # Nine tenths of what is outside may be failures that none of thirty trials happened to show.
    assert 0.5 < told.recall.low < told.precision.low
    assert (told.recall.hits, told.recall.total) == (30, 30)


def test_failures_outside_count_as_often_as_they_occur() -> None:
    predicted, failed = [True] * 30 + [False] * 30, [True] * 30 + [True] * 3 + [False] * 27
    rare, common = scores(predicted, failed, 0.1), scores(predicted, failed, 0.9)
    assert rare.recall.rate == pytest.approx(0.1 / (0.1 + 0.9 * 0.1))
    assert common.recall.rate == pytest.approx(0.9 / (0.9 + 0.1 * 0.1))


def test_nothing_is_claimed_without_trials() -> None:
    none = scores([], [], 0.5)
    assert none.precision.rate is none.recall.rate is none.balanced_accuracy is None
    assert (none.recall.low, none.recall.high) == (0.0, 1.0)
    passed = scores([False] * 20, [False] * 20, 0.0)
    assert passed.recall.rate is passed.balanced_accuracy is None
    always = scores([True] * 20, [True] * 20, 1.0)
    assert always.precision.rate == 1.0
    assert always.balanced_accuracy is None


@pytest.mark.parametrize(("share", "inside", "outside"), [(0.3, 0.95, 0.02), (0.05, 0.9, 0.01), (0.6, 1.0, 0.1)])
def test_intervals_cover(share: float, inside: float, outside: float) -> None:
    """Precision and recall of a rule with known rates of failure inside and outside of it."""
    chance = np.random.default_rng(7)
    truth = share * inside / (share * inside + (1 - share) * outside)
    covered = {"precision": 0, "recall": 0}
    for _ in range(400):
        failed = [*(chance.random(30) < inside), *(chance.random(30) < outside)]
        told = scores([True] * 30 + [False] * 30, failed, share)
        covered["precision"] += told.precision.low <= inside <= told.precision.high
        covered["recall"] += told.recall.low <= truth <= told.recall.high
    assert min(covered.values()) >= 0.95 * 400


def test_cases_lie_on_both_sides_of_a_limit_mirrored_and_in_its_interval() -> None:
    variable = Variable("x", "int32", 5000, (), tuple(range(10)), (0, -1, 5000))
    table = Table([variable])
    table.add([{"x": 900}, {"x": 1100}], [False, True])
    rule = Learnt(((Candidate(Feature("raw", ("x",)), ">", 1.0, 900, 1100),),), 1.0, 0)
    cases = near_limits(table, rule, Sampler([variable]), random.Random(1), 400)
    values = {int(case["x"]) for case in cases}
    assert rule.rule.text() == "x > 900"
    assert {899, 900, 901, 1000} <= values
    assert any(901 < value < 1000 for value in values)
    assert any(450 < value < 899 for value in values)
    assert any(-1400 < value < -450 for value in values)
    assert len(cases) > 390


def test_other_values_are_near_a_category() -> None:
    variable = Variable("s", "string", "auto", (), ("auto", "off"), ())
    table = Table([variable])
    table.add([{"s": "auto"}], [True])
    rule = Learnt(((Candidate(Feature("raw", ("s",)), "==", 1.0, inside="auto"),),), 1.0, 0)
    cases = near_limits(table, rule, Sampler([variable]), random.Random(1), 100)
    assert len({case["s"] for case in cases}) > 10
    assert near_limits(table, Learnt(((),), 0.0, 0), Sampler([variable]), random.Random(1), 100) == []


def test_limits_are_looked_at_where_the_rest_of_the_rule_holds() -> None:
    size, mode = Variable("x", "int32", 5000), Variable("m", "int32", 7)
    table = Table([size, mode])
    rows = [{"x": x, "m": m} for x in (900, 1100) for m in range(40)]
    table.add(rows, [row["x"] > 1000 and row["m"] == 7 for row in rows])
    limit = Candidate(Feature("raw", ("x",)), ">", 1.0, 900, 1100)
    rule = Learnt(((limit, Candidate(Feature("raw", ("m",)), "==", 1.0, inside=7)),), 1.0, 0)
    cases = near_limits(table, rule, Sampler([size, mode]), random.Random(1), 400)
    assert sum(case["m"] == 7 for case in cases) > 100
