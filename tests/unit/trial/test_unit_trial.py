"""What outputs show of a unit's behaviour."""

from __future__ import annotations

import json
from typing import Any

import pytest

from riot_bus.trial.unit_trial import behaviour_of
from riot_bus.types.json_type import JsonType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message


def told(*outputs: tuple[str, Any], registry: TypeRegistry | None = None) -> dict[str, list[str]]:
    messages = [
        Message(number, topic, json.dumps(document).encode(), encoding="application/json")
        for number, (topic, document) in enumerate(outputs)
    ]
    return behaviour_of(messages, registry or TypeRegistry())


def test_numbers_order_and_modes() -> None:
    found = told(*[("state", {"mode": mode, "on": True, "x": 1.5}) for mode in ("idle", "idle", "run")], ("log", 7))
    assert found == {
        "number of log": ["1"],
        "number of state": ["2"],
        "order": ["state > log", "state > state"],
        "state:mode": ["'idle'", "'idle' > 'run'", "'run'"],
        "state:on": ["True"],
        "log:value": ["7"],
    }


def test_counts_and_stamps_are_no_modes() -> None:
    found = told(*[("state", {"count": number, "seq": 1, "stamp": 3}) for number in range(20)])
    assert set(found) == {"number of state", "order"}


def test_nothing_and_what_cannot_be_taken_apart() -> None:
    assert told() == {"order": []}
    broken = [Message(0, "state", b"{", encoding="application/json"), Message(1, "state", b"", kind="delete")]
    assert behaviour_of(broken, TypeRegistry()) == {"number of state": ["2"], "order": ["state > state"]}


def test_payloads_that_come_again_are_taken_apart_once(monkeypatch: pytest.MonkeyPatch) -> None:
    taken_apart: list[bytes] = []
    leaves = JsonType.leaves

    def counted(kind: JsonType, payload: bytes, **options: Any) -> Any:
        taken_apart.append(payload)
        return leaves(kind, payload, **options)

    monkeypatch.setattr(JsonType, "leaves", counted)
    outputs = [("again", {"mode": number % 3, "text": f"once {number % 7}"}) for number in range(50)]
    registry = TypeRegistry()
    assert told(*outputs, registry=registry) == told(*outputs)
    taken_apart.clear()
    assert told(*outputs, registry=registry) == told(*outputs, registry=registry)
    assert not taken_apart


def test_it_is_bounded() -> None:
    found = told(*[(f"t{number}", {f"f{n}": n for n in range(50)}) for number in range(200)])
    assert len(found) <= 64
    assert max(map(len, found.values())) <= 64
