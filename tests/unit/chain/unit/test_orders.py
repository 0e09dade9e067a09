"""A failure that depends on the order of two messages, or on the message before."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from riot_bus.chain.steps.permeability import permeability
from riot_bus.chain.steps.relevance import relevance
from riot_bus.chain.steps.rules import rules
from riot_bus.chain.unit.prediction import predict
from riot_bus.findings.records import FindingRecord, MinimalRecord, RuleRecord
from riot_bus.generalize.rule import Rule
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.message import Message
from tests.unit.chain.machine import SYSTEM, Bench, bench, rated, said, write_finding

ARMED = SYSTEM.replace('inputs = ["command"]', 'inputs = ["command", "arm"]')


def message(topic: str, number: int, **values: object) -> Message:
    return Message(10**18 + number * 50_000_000, topic, json.dumps(values).encode(), sequence=number)


def armed(messages: Sequence[Message]) -> int | None:
    """The drive hangs on a command once it is armed."""
    keys = [one.key for one in messages]
    return next((place for place, key in enumerate(keys) if key == "command" and "arm" in keys[:place]), None)


def armed_first(messages: Sequence[Message]) -> int | None:
    """It hangs on its first command, if it is armed by then."""
    keys = [one.key for one in messages]
    first = keys.index("command") if "command" in keys else 0
    return first if "arm" in keys[:first] else None


def jumps(messages: Sequence[Message]) -> int | None:
    """It hangs on a number that does not rise."""
    last = None
    for place, one in enumerate(messages):
        try:
            number = said(one).get("seq")
        except ValueError:
            continue
        if isinstance(number, int) and last is not None and number <= last:
            return place
        last = number if isinstance(number, int) else last
    return None


def learnt(one: Bench, messages: Sequence[Message], originals: dict[int, Message]) -> RuleRecord:
    write_finding(one, messages, originals, "minimal")
    topics = tuple(each.key for each in messages)
    MinimalRecord(before=60, kept=(7, 8), topics=topics, one_minimal=True).save(one.folder)
    rated(one, 4, 4)
    relevance(one.run(), one.folder).save(one.folder)
    return rules(one.run(), one.folder, budget=80, validation=20)


def held(record: RuleRecord, topics: str) -> list[int]:
    log = [message({"a": "arm", "c": "command"}[each], place, mode="step") for place, each in enumerate(topics)]
    found = predict(Rule.from_json(record.rule), record.topics, log, registry=TypeRegistry())
    return [one.place for one in found.moments]


@pytest.mark.parametrize(
    ("fails", "text", "places"),
    [(armed, "arm before command", [2, 4]), (armed_first, "arm before the first command", [])],
)
def test_an_order_is_a_rule(tmp_path: Path, fails: object, text: str, places: list[int]) -> None:
    one = bench(tmp_path, ARMED, fails=fails)
    record = learnt(one, [message("arm", 0, who="a"), message("command", 1, mode="step", speed=3.5)], {})
    assert record.text == text
    assert record.topics == ("arm", "command")
    assert record.types == {text: "bool"}
    assert record.checks > 0
    assert record.in_context is not None
    assert record.in_context.count == record.in_context.total > 0
    assert FindingRecord.load(one.folder).ordered
    assert "latest message" in record.stl_missing
    assert held(record, "cacac") == places
    assert held(record, "acc")[:1] == [1]
    record.save(one.folder)
    with pytest.raises(InconclusiveError, match="order of messages"):
        permeability(one.run(), one.folder)


def test_without_an_order_that_matters_there_is_none(tmp_path: Path) -> None:
    one = bench(tmp_path, ARMED, fails=lambda log: 1 if {"arm", "command"} <= {each.key for each in log} else None)
    write_finding(one, [message("arm", 0), message("command", 1, mode="step")], {}, "minimal")
    MinimalRecord(before=60, kept=(7, 8), topics=("arm", "command"), one_minimal=True).save(one.folder)
    rated(one, 4, 4)
    found = relevance(one.run(), one.folder)
    assert "arm before command" in found.considered
    assert not found.fields


def test_the_message_before_is_varied_though_numbers_are_left_alone_else(tmp_path: Path) -> None:
    one = bench(tmp_path, fails=jumps)
    messages = [message("command", 4, seq=4, speed=1.0), message("command", 5, seq=0, speed=1.0)]
    record = learnt(one, messages, {5: message("command", 5, seq=5, speed=1.0)})
    assert record.text == "command:seq <= previous command:seq"
    assert set(record.types) == {"command[0]:seq", "command[1]:seq"}
    log = [message("command", place, seq=number) for place, number in enumerate([3, 4, 4, 7, 6])]
    found = predict(Rule.from_json(record.rule), record.topics, log, registry=TypeRegistry())
    assert [each.place for each in found.moments] == [2, 4]
    assert "previous command:seq = 4, command:seq = 4" in found.lines()[1]
