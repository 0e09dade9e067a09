"""The log tells when fields have which of their few values."""

from __future__ import annotations

import json
from typing import Any

from riot_bus.campaign.schedule import positions_of
from riot_bus.campaign.situations import Situation, Window, numbers_within, situations_of
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.predicate import parse_predicate


def log(*documents: tuple[str, dict[str, Any]]) -> list[Message]:
    return [Message(10**18 + n * 10**8, key, json.dumps(each).encode()) for n, (key, each) in enumerate(documents)]


def found(messages: list[Message]) -> dict[str, tuple[Window, ...]]:
    return {each.where: each.windows for each in situations_of(messages, TypeRegistry())}


def test_a_situation_lasts_until_another_value_comes() -> None:
    messages = log(
        ("drive", {"speed": 1.5}),
        ("mode", {"mode": 1}),
        ("drive", {"speed": 1.5}),
        ("mode", {"mode": 2}),
        ("drive", {"speed": 2.5}),
        ("mode", {"mode": 2}),
        ("mode", {"mode": 1}),
        ("drive", {"speed": 3.5}),
    )
    assert found(messages) == {
        "mode == 1": (Window(1, 3, 0.1, 0.3), Window(6, 8, 0.6, None)),
        "mode == 2": (Window(3, 6, 0.3, 0.6),),
    }
    drive = positions_of(messages, TypeRegistry())["drive"]
    assert numbers_within(Window(3, 6, 0.3, 0.6), drive) == range(2, 3)
    assert numbers_within(Window(5, 6, 0.5, 0.6), drive) == range(3, 3)


def test_what_is_constant_counts_measures_or_identifies_is_no_situation() -> None:
    documents = [
        {"n": n, "x": n % 2 / 2, "same": 3, "seq": n % 2, "text": "A" * 99 * (n % 2), "list": [n % 2]} for n in range(9)
    ]
    assert found(log(*(("a", each) for each in documents))) == {}


def test_predicates_hold_of_the_messages_that_a_situation_begins_with() -> None:
    values: list[Any] = [True, False, "a", 'quo"ted', "\u00e4", 7]
    messages = log(*(("a", {"v": value, "odd name": n % 2}) for n, value in enumerate(values)))
    situations = situations_of(messages, TypeRegistry())
    assert {each.path for each in situations} == {"v"}
    for each in situations:
        if each.where:
            for window in each.windows:
                document = json.loads(messages[window.first].payload)
                assert parse_predicate(each.where)(document.__getitem__)
    assert {each.where for each in situations if each.path == "v"} == {
        "v == true",
        "v == false",
        'v == "a"',
        "",
        "v == 7",
    }


def test_of_a_long_log_some_messages_are_looked_at() -> None:
    messages = log(*(("a", {"on": n >= 3000}) for n in range(4000)))
    off, on = situations_of(messages, TypeRegistry())
    assert isinstance(on, Situation)
    assert abs(on.windows[0].first - 3000) <= 10
    assert off.windows[0].behind == on.windows[0].first


def test_messages_that_cannot_be_read_are_passed_over() -> None:
    assert situations_of([Message(1, "a", b"\xff\x00"), Message(2, "a", b"{}")], TypeRegistry()) == []
