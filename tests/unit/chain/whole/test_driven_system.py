from __future__ import annotations

from typing import Any

import pytest

from riot_bus.chain.whole.driven_system import least_distance
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.vocabulary.trial import Series
from tests.unit.chain.machine import MODE, SPEED


def test_the_distance_to_a_rule_is_the_least_over_a_run() -> None:
    rule = Rule(((Literal(Feature("raw", (SPEED,)), "<", 1),),))
    near = least_distance(rule, {SPEED: Series((0.0, 1.0, 2.0), (9.0, 4.0, 7.0))}, {SPEED: 0.5})
    far = least_distance(rule, {SPEED: Series((0.0, 1.0), (9.0, 7.0))}, {SPEED: 0.5})
    assert near is not None
    assert far is not None
    assert 0 < near < far
    assert least_distance(rule, {SPEED: Series()}, {SPEED: 0.5}) is None


@pytest.mark.parametrize("terms", [(), ((),)], ids=["never", "always"])
def test_a_rule_without_a_field_has_no_distance(terms: tuple[tuple[Literal, ...], ...]) -> None:
    assert least_distance(Rule(terms), {}, {}) is None


@pytest.mark.parametrize(("value", "usual"), [(True, False), ("step", "hold"), (3, 4)])
def test_the_distance_is_negative_where_a_rule_of_values_of_any_type_is_met(value: Any, usual: Any) -> None:
    rule = Rule(((Literal(Feature("raw", (MODE,)), "==", value), Literal(Feature("raw", (SPEED,)), "<", 1)),))
    speeds = Series((0.0, 1.0, 2.0), (9.0, 0.5, 9.0))
    at_once = {MODE: Series((0.1, 0.9, 2.1), (usual, value, usual)), SPEED: speeds}
    apart = {MODE: Series((0.1, 0.9, 2.1), (usual, usual, value)), SPEED: speeds}
    met, missed = (least_distance(rule, observed, {SPEED: 1.0}) for observed in (at_once, apart))
    assert met is not None
    assert missed is not None
    assert met < 0 < missed


def test_two_messages_of_a_topic_are_told_apart_in_time() -> None:
    rise = Literal(Feature("sub", ("command[1]:speed", "command[0]:speed")), ">", 5)
    slow, quick = (Series((0.0, 1.0, 2.0), values) for values in ((1.0, 4.0, 8.0), (1.0, 2.0, 8.0)))
    topics = ("command", "command")
    far, met = (least_distance(Rule(((rise,),)), {SPEED: one}, {}, topics) for one in (slow, quick))
    assert far is not None
    assert met is not None
    assert met < 0 < far
    assert least_distance(Rule(((rise,),)), {SPEED: Series((0.0,), (1.0,))}, {}, topics) is None
