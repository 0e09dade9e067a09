"""A rule over a whole log, against the rule asked by hand at each message."""

from __future__ import annotations

import json
import random

import pytest

from riot_bus.chain.prediction import predict
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


def test_a_name_for_which_there_is_no_message_is_an_error() -> None:
    rule = Rule(((Literal(Feature("raw", ("a[2]:x",)), ">", 5),),))
    with pytest.raises(ConfigError, match="there are 2 of a"):
        predict(rule, ("a", "a"), [], registry=TypeRegistry())
