"""What a rule's record says of where the rule is wrong."""

from __future__ import annotations

from typing import Any

import pytest

from riot_bus.findings.records import ProportionRecord, RuleRecord
from riot_bus.statistics.rates import proportion


def rate(count: int, total: int) -> ProportionRecord:
    found = proportion(count, total)
    return ProportionRecord(value=found.rate, low=found.low, high=found.high, count=count, total=total)


@pytest.mark.parametrize(
    ("known", "told"),
    [
        ({"unjudged": 0, "in_campaign": rate(5, 5)}, "and 5 of 5 of the campaign, 0 trials)"),
        (
            {"unjudged": 12, "in_campaign": rate(129, 141)},
            "and 129 of 141 of the campaign; 12 further trials of the campaign could not be judged, 0 trials)",
        ),
        ({"unjudged": 1}, " fresh checks; 1 trial of the campaign could not be judged, 0 trials)"),
    ],
)
def test_trials_that_the_rule_cannot_judge_are_told(known: dict[str, Any], told: str) -> None:
    fields = {"balanced_accuracy": 1.0, "checks": 60, "precision": rate(30, 30), "recall": rate(30, 30)} | known
    assert RuleRecord(text="x > 5", rule={}, scale={}, **fields).summary.endswith(told)


@pytest.mark.parametrize(
    ("known", "told"),
    [
        ({}, ""),
        ({"in_campaign": rate(98, 98), "in_context": rate(23, 24)}, ""),
        ({"in_campaign": rate(77, 112)}, "right in only 77 of 112 trials of the campaign"),
        ({"in_context": rate(8, 14)}, "right in only 8 of 14 trials that start with nominal messages"),
        (
            {"varied_mistakes": 10, "varied_checks": 19},
            "wrong in 10 of 19 checks with other values of all other fields",
        ),
        ({"varied_mistakes": 1, "varied_checks": 20}, ""),
        (
            {"own_mistakes": 1, "own_mistake": {"x": float("nan"), "mode": 1}},
            "wrong in 1 of the trials that it was learnt from: x = nan, mode = 1",
        ),
        ({"balanced_accuracy": None, "checks": 60}, "tested with one outcome only"),
        ({"balanced_accuracy": None, "checks": 0}, "not tested"),
    ],
)
def test_shortcomings(known: dict[str, Any], told: str) -> None:
    fields = {"balanced_accuracy": 1.0, "checks": 60, "precision": rate(30, 30), "recall": rate(30, 30)} | known
    assert RuleRecord(text="x > 5", rule={}, scale={}, **fields).shortcomings == told
