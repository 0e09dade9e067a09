from __future__ import annotations

from typing import Any

import pytest

from riot_bus.campaign.effects import Effects
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict

X, Y, DROP = Injection("a", "x", 1.0), Injection("b", "y", 2), Injection("b", fault="drop")


def outcome(verdict: Verdict = Verdict.PASS, **statistics: Any) -> Outcome:
    return Outcome(verdict, statistics=statistics)


NOMINAL = [outcome(shown={"out": (5, "same")})] * 4
VARYING = [outcome(shown={"out": (5, str(number))}) for number in range(4)]


@pytest.mark.parametrize(
    ("shown", "nominal", "name"),
    [
        ({"out": (5, "same")}, NOMINAL, "without_effect"),
        ({"out": [5, "same"]}, NOMINAL, "without_effect"),  # as the store gives it back
        ({"out": (5, "other")}, NOMINAL, "with_effect"),
        ({"out": (4, "other")}, NOMINAL, "with_effect"),
        ({}, NOMINAL, "with_effect"),
        ({"out": (5, "same"), "more": (1, "m")}, NOMINAL, "with_effect"),
        ({"out": (5, "other")}, VARYING, "untold"),
        ({"out": (6, "other")}, VARYING, "with_effect"),
        ({}, [outcome(shown={})] * 4, "untold"),
        (None, NOMINAL, "untold"),
        ({"out": (5, "same")}, [], "untold"),
    ],
)
def test_outputs_are_compared_with_those_of_nominal_trials(shown: Any, nominal: list[Outcome], name: str) -> None:
    effects = Effects()
    effects.add(TestCase(injections=(X, Y)), outcome(shown=shown, delivered=[3, 0]), nominal)
    assert (effects.injections, effects.undelivered, getattr(effects, name)) == (2, 1, 1)
    assert effects.without_effect + effects.with_effect + effects.untold + effects.failing == 1


def test_injections_are_counted_by_what_came_of_them() -> None:
    effects = Effects()
    case = TestCase(injections=(X, Y, DROP))
    effects.add(case, outcome(Verdict.FAIL, delivered=[2, 0, 1]), NOMINAL)
    effects.add(case, outcome(delivered=[1, 0, 0], shown={}), NOMINAL)
    effects.add(case, outcome(Verdict.ERROR, delivered=[1, 1, 1]), NOMINAL)
    effects.add(case, outcome(), NOMINAL)  # a runner that does not tell
    assert (effects.injections, effects.undelivered, effects.failing) == (6, 3, 2)
