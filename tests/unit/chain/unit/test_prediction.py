"""A rule over a whole log, against the rule asked by hand at each message."""

from __future__ import annotations

import json
import random

import pytest

from riot_bus.chain.unit.prediction import Prediction, _shows_keeping, _Tried, predict
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message


def message(number: int, topic: str, **values: object) -> Message:
    return Message(10**18 + number * 10**6, topic, json.dumps(values).encode(), encoding="application/json")


BEYOND = Rule(((Literal(Feature("sub", ("pick:index", "map:size")), ">=", 0),),))


def test_fields_of_other_topics_are_those_of_the_latest_message() -> None:
    log = [message(0, "pick", index=99), message(1, "map", size=10)]
    log += [message(2, "pick", index=9), message(3, "pick", index=10), message(4, "other", index=99)]
    log += [message(5, "map", size=11), message(6, "pick", index=10)]
    found = predict(BEYOND, ("map", "pick"), log, registry=TypeRegistry())
    assert (found.judged, found.unknown, found.fails) == (5, 1, 2)  # the first pick comes before any map
    assert [one.place for one in found.moments] == [1, 3]
    assert found.moments[1].values == {"pick:index": 10, "map:size": 10}


def test_the_messages_of_one_topic_count_from_the_latest_one() -> None:
    falls = Rule(((Literal(Feature("sub", ("a[1]:x", "a[0]:x")), "<", 0),),))
    seen = [3, 5, 4, 4, 1, 2]
    log = [message(number, "a", x=x) for number, x in enumerate(seen)]
    found = predict(falls, ("a", "a"), log, registry=TypeRegistry())
    wanted = [number for number in range(1, 6) if seen[number] < seen[number - 1]]
    assert [one.place for one in found.moments] == wanted
    assert (found.judged, found.unknown) == (5, 1)


def test_what_cannot_be_read_is_unknown_and_other_types_are_judged_as_they_are() -> None:
    rule = Rule(((Literal(Feature("raw", ("a:x",)), ">", 5),), (Literal(Feature("raw", ("a:x",)), "==", "off"),)))
    values = [6, "off", 6.5, None, 4, "on", True, 2**63]
    log = [message(number, "a", x=value) for number, value in enumerate(values)]
    log += [message(8, "a", y=1), Message(10**18, "a", b"{", encoding="application/json")]
    found = predict(rule, ("a",), log, registry=TypeRegistry())
    assert [one.place for one in found.moments] == [0, 1, 2, 7]
    assert found.judged + found.unknown == len(log)
    assert found.unknown >= 2


def test_long_logs_are_judged_in_parts_and_moments_are_bounded() -> None:
    draw = random.Random(5)
    seen = [draw.randint(0, 10) for _ in range(9_000)]
    rule = Rule(((Literal(Feature("raw", ("a:x",)), ">", 5),),))
    found = predict(
        rule, ("a",), (message(i, "a", x=x) for i, x in enumerate(seen)), registry=TypeRegistry(), at_most=7
    )
    assert found.fails == sum(x > 5 for x in seen)
    assert [one.place for one in found.moments] == [i for i, x in enumerate(seen) if x > 5][:7]


HIGH, LOW = Literal(Feature("raw", ("a:x",)), ">", 5), Literal(Feature("raw", ("a:y",)), "<", 0)
FAR = Literal(Feature("sub", ("b:z", "a:x")), ">", 3)


@pytest.mark.parametrize("seed", range(3))
def test_known_fields_decide_where_others_are_unknown(seed: int) -> None:
    """Against the terms asked one by one at each message."""
    draw, rule = random.Random(seed), Rule(((HIGH, LOW), (FAR,), (LOW, FAR)))
    log, wanted, unknown, known = [], [], 0, {}
    for number in range(500):
        topic = draw.choice("ab")
        drawn = {name: draw.randint(-9, 9) for name in {"a": "xy", "b": "z"}[topic] if draw.random() < 0.7}
        log.append(message(number, topic, **drawn))
        known = {name: value for name, value in known.items() if name[0] != topic}
        known |= {f"{topic}:{name}": value for name, value in drawn.items()}
        x, y, z = (known.get(name) for name in ("a:x", "a:y", "b:z"))
        low = None if y is None else y < 0
        high = None if x is None else x > 5
        far = None if x is None or z is None else z - x > 3
        terms = [all_of(high, low), far, all_of(low, far)]
        if any(terms):
            wanted.append(number)
        elif None in terms:
            unknown += topic == "b"
    found = predict(rule, ("a", "b"), log, registry=TypeRegistry(), at_most=500)
    assert [one.place for one in found.moments] == wanted
    assert (found.fails, found.unknown) == (len(wanted), unknown)
    assert wanted
    assert unknown


def all_of(*literals: bool | None) -> bool | None:
    return False if False in literals else None if None in literals else True


@pytest.mark.parametrize(
    ("log", "said"),
    [
        ([{"x": 1}, {"x": 6}], True),
        ([{"y": 1}, {"x": 6}], True),
        ([{"x": 1}, {"x": 2}], False),
        ([{"y": 1}, {"x": 2}], None),
    ],
)
def test_a_log_would_not_fail_only_if_all_messages_were_judged(log: list[dict[str, int]], said: bool | None) -> None:
    messages = [message(number, "a", **values) for number, values in enumerate(log)]
    found = predict(Rule(((HIGH,),)), ("a",), messages, registry=TypeRegistry())
    assert (found.would_fail, found.to_json()["would_fail"]) == (said, said)
    start = {True: "would fail: ", False: "would not fail: ", None: "not known whether it would fail: "}[said]
    assert found.lines()[0].startswith(start)
    assert ("more it is not known" in found.lines()[0]) == ({"y": 1} in log)


def test_failures_that_the_rule_missed_are_told_where_it_holds_nowhere() -> None:
    lines = Prediction("a:x > 5", judged=3, missed=2).lines()
    assert lines[1:] == ["  2 trials of the campaign failed though it holds nowhere in them"]
    assert len(Prediction("a:x > 5", judged=3, fails=1, missed=2).lines()) == 1


def test_a_log_without_the_last_topic_says_nothing() -> None:
    rule = Rule(((HIGH, Literal(Feature("raw", ("b:z",)), ">", 0)),))
    found = predict(rule, ("a", "b"), [message(0, "a", x=1), message(1, "a", x=6)], registry=TypeRegistry())
    assert (found.judged, found.unknown, found.fails) == (0, 0, 0)


def test_terms_with_an_order_hold_only_at_its_second_topic() -> None:
    rule = Rule(((Literal(Feature("raw", ("a before b",)), "==", True), HIGH), (LOW,)))
    log = [message(0, "b"), message(1, "a", x=6, y=1), message(2, "b"), message(3, "a", x=6, y=-1), message(4, "b")]
    found = predict(rule, ("a", "b"), log, registry=TypeRegistry())
    assert [one.place for one in found.moments] == [2, 3, 4]
    assert (found.judged, found.unknown) == (3, 1)  # before the first a, y is not known


@pytest.mark.parametrize("keeps", [False, True])
def test_a_message_without_a_field_may_leave_the_earlier_value_in_force(*, keeps: bool) -> None:
    log = [message(0, "a", x=6, y=0), message(1, "a", y=-1), message(2, "a", x=1)]
    found = predict(Rule(((HIGH, LOW),)), ("a",), log, registry=TypeRegistry(), keeps=keeps)
    assert (found.judged, found.unknown, found.fails) == ((3, 0, 1) if keeps else (2, 1, 0))


@pytest.mark.parametrize(
    ("tried", "keeps"),
    [
        ([(True, None, True)], True),
        ([(True, None, True), (False, None, True)], False),
        ([(True, None, True), (True, False, True), (False, None, True)], True),
        ([(False, None, False)], False),
        ([(True, True, True), (True, None, None)], False),
        ([(True, None, True), (True, True, False)], False),
    ],
)
def test_trials_show_that_earlier_values_are_kept(
    tried: list[tuple[bool, bool | None, bool | None]], *, keeps: bool
) -> None:
    assert _shows_keeping([_Tried([], failed, said, kept) for failed, said, kept in tried]) == keeps


def test_a_name_for_which_there_is_no_message_is_an_error() -> None:
    rule = Rule(((Literal(Feature("raw", ("a[2]:x",)), ">", 5),),))
    with pytest.raises(ConfigError, match="there are 2 of a"):
        predict(rule, ("a", "a"), [], registry=TypeRegistry())
