"""The log tells which values are worth trying."""

from __future__ import annotations

import json
from typing import Any

from riot_bus.campaign.observed import with_observed
from riot_bus.campaign.targets import targets_of
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message


def values(*documents: dict[str, Any]) -> dict[str, set[Any]]:
    messages = [Message(10**9 + n, "a", json.dumps(each).encode()) for n, each in enumerate(documents)]
    targets = with_observed(targets_of(messages, TypeRegistry()), messages, TypeRegistry())
    return {each.path: {told.value for told in each.told} for each in targets.get("a", ())}


def test_limits_and_one_beyond() -> None:
    found = values({"i": 3}, {"i": 7}, {"i": 5})
    assert found == {"i": {2, 3, 5, 7, 8}}
    assert values({"i": 3}, {"i": 3}) == {"i": {2, 4}}
    assert values({"x": 0.5, "b": True}, {"x": -0.5, "b": False}) == {"x": {-1.5, -0.5, 0.5, 1.5}, "b": set()}


def test_some_numbers_of_other_messages() -> None:
    assert values(*({"i": i} for i in (4, 0, 9, 8, 4, 6, 5)))["i"] == {-1, 0, 9, 10, 4, 6, 5}
    many = [0, 1000, *range(1, 150)]
    assert values(*({"i": i} for i in many))["i"] == {-1, 0, 1000, 1001, 1, 75, 149}


def test_texts_of_other_messages_and_of_other_fields() -> None:
    found = values({"mode": "auto", "state": "idle"}, {"mode": "dock", "state": "idle"})
    assert found == {"mode": {"auto", "dock", "idle"}, "state": {"auto", "dock"}}


def test_numbers_of_other_fields_are_those_of_the_same_type() -> None:
    assert values({"i": 3, "k": 40, "x": 0.5, "long": "A" * 5000, "s": "b"}) == {
        "i": {2, 4, 40},
        "k": {39, 41, 3},
        "x": {-0.5, 1.5},
        "long": {"b"},
        "s": set(),
    }


def test_what_is_no_number_is_no_limit() -> None:
    assert values({"x": float("nan")}, {"x": float("inf")}, {"x": 2.0}) == {"x": {1.0, 3.0}}
