from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from riot_bus.chain.base.logs import FailingLog, NamedFields
from riot_bus.chain.steps.relevance import relevance
from riot_bus.chain.unit.structure import parts_of, search_structure
from riot_bus.findings.records import FieldsRecord, MinimalRecord
from riot_bus.statistics.noise import Noise
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import COUNT, MODE, SPEED, SYSTEM, Bench, bench, command, said, write_finding

REGISTRY = TypeRegistry()
CONFIRMED = Noise.after(4, 4, nominal_total=4)


def message(number: int, key: str = "cmd", **values: Any) -> Message:
    return Message(10**18 + number * 10**9, key, json.dumps(values).encode(), sequence=number)


def needed(log: FailingLog, fails: Callable[[Sequence[Message]], bool], *, paced: bool = False) -> list[str]:
    fields = NamedFields(log, registry=REGISTRY)
    parts = parts_of(fields, list(fields.fields.values()), (), paced=paced)
    structure = search_structure(
        log,
        parts,
        lambda logs: [fails(each.messages) for each in logs],
        noise=CONFIRMED,
        budget=500,
        parallelism=1,
        progress=None,
    )
    assert structure.asked == Counter(part.kind for part in parts)
    for one in structure.needed:
        assert fails(one.failing.messages)
        assert not fails(one.passing.messages)
    return [f"{one.part.kind} {one.part.name} {one.part.then}".strip() for one in structure.needed]


def test_keys_that_have_to_be_there() -> None:
    log = FailingLog((message(0, x=1, y={"z": 2, "w": [1, 2]}, s="a"),), {})
    assert needed(log, lambda messages: "z" in json.loads(messages[0].payload)["y"]) == ["key cmd:y.z"]
    assert needed(log, lambda messages: True) == []
    known = parts_of(NamedFields(log, registry=REGISTRY), [], ("cmd:x",), paced=False)
    assert known == []


def test_a_key_that_has_to_be_missing() -> None:
    log = FailingLog((message(3, x=7, s="a"),), {3: message(3, x=1, y=5, s="a")})

    def fails(messages: Sequence[Message]) -> bool:
        return "y" not in json.loads(messages[0].payload) and json.loads(messages[0].payload).get("x") == 7

    assert needed(log, fails) == ["missing key cmd:y", "key cmd:x"]


@pytest.mark.parametrize("empty", [None, [], {}])
def test_a_key_that_has_no_value_is_not_called_missing(empty: object) -> None:
    log = FailingLog((message(3, x=7, y=empty),), {3: message(3, x=7, y=5)})
    assert needed(log, lambda messages: json.loads(messages[0].payload).get("y", 1) == empty) == ["no value cmd:y"]


def test_the_order_of_two_messages() -> None:
    log = FailingLog((message(0, x=1), message(1, "mode", m=2), message(2, x=3)), {})

    def fails(messages: Sequence[Message]) -> bool:
        keys = [each.key for each in messages]
        return keys.index("cmd") < keys.index("mode") and len(messages) == 3

    assert needed(log, fails) == ["order cmd[0] mode"]


def test_what_has_to_come_soon() -> None:
    log = FailingLog((message(0, x=1), message(1, x=2), message(2, x=3)), {})

    def fails(messages: Sequence[Message]) -> bool:
        return messages[2].time - messages[1].time < 2e9

    assert needed(log, fails, paced=True) == ["gap cmd[1] cmd[2]"]


def minimal(one: Bench, messages: Sequence[Message], originals: dict[int, Message]) -> None:
    write_finding(one, messages, originals, "minimal")
    topics = ("command",) * len(messages)
    MinimalRecord(before=COUNT, kept=tuple(range(len(messages))), topics=topics, one_minimal=True).save(one.folder)


def test_relevance_tells_keys_and_order_with_confirmed_certificates(tmp_path: Path) -> None:
    """The drive fails by a step without a note, if the message before has one, whatever the note is."""

    def fails(messages: Sequence[Message]) -> int | None:
        values = [said(each) for each in messages]
        pairs = pairwise(values)
        return next((place + 1 for place, (a, b) in enumerate(pairs) if "note" in a and "note" not in b), None)

    one = bench(tmp_path, fails=fails)
    bare = command("step", 3.0, 1).with_(payload=b'{"mode": "step", "speed": 3.0}')
    minimal(one, [command("step", 3.0, 0), bare], {1: command("step", 3.0, 1)})
    record = relevance(one.run(), one.folder)
    assert record.fields == ()
    assert {str(each) for each in record.structure} == {
        "command[0]:note is there",
        "command[1]:note is missing",
        "command[0] comes before command[1]",
    }
    for each in record.structure:
        assert each.failed == each.passed == (3, 3)
        for name, right in ((each.failing_log, True), (each.passing_log, False)):
            log = FailingLog.load(one.folder / name, registry=one.workspace.context.registry)
            assert (fails(log.messages) is not None) is right
    assert "it needs that command[1]:note is missing" in record.summary
    record.save(one.folder)
    assert FieldsRecord.load(one.folder) == record


def test_keys_of_fields_whose_values_decide_are_not_asked(tmp_path: Path) -> None:
    one = bench(tmp_path)
    minimal(one, [command("step", -5.0)], {0: command("step", 3.0)})
    record = relevance(one.run(), one.folder)
    assert {field.name for field in record.fields} == {SPEED, MODE}
    assert record.structure == ()
    assert record.structure_known == {"key": 1}  # the note
    assert record.structure_failed[0] == record.structure_failed[1] > 0


@pytest.mark.parametrize("budget", [8, 30])
def test_trials_that_are_spent_tell_nothing_of_the_structure(tmp_path: Path, budget: int) -> None:
    one = bench(tmp_path, SYSTEM)
    minimal(one, [command("step", -5.0)], {0: command("step", 3.0)})
    record = relevance(one.run(), one.folder, budget=budget)
    assert record.structure_known == {"key": 0}, "one message has no neighbours; its keys were not decided on"
