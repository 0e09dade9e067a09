"""Fields that may be modes."""

from __future__ import annotations

import json
from typing import Any

import pytest

from riot_bus.inject.modes import modes_of
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message


@pytest.mark.parametrize(
    ("document", "paths"),
    [
        ({"mode": "auto", "on": True, "level": 2, "x": 1.5}, ["mode", "on", "level"]),
        ({"label": "a" * 64, "name": "a" * 63}, ["name"]),
        ({"seq": 1, "stamp": 2, "crc": 3}, []),
        ({"list": [1, 2], "inner": {"phase": 1}}, ["inner.phase"]),
    ],
)
def test_truth_values_integers_and_short_texts_count(document: dict[str, Any], paths: list[str]) -> None:
    message = Message(0, "a", json.dumps(document).encode(), encoding="application/json")
    assert [path for path, _ in modes_of(message, TypeRegistry())] == paths


def test_what_cannot_be_taken_apart_has_none() -> None:
    assert modes_of(Message(0, "a", b"{", encoding="application/json"), TypeRegistry()) == ()
    assert modes_of(Message(0, "a", b"", kind="delete"), TypeRegistry()) == ()
