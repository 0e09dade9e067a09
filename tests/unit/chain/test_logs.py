"""Fields of a short log: lengths that an injection has changed are fields like others."""

from __future__ import annotations

import json
from typing import Any

from riot_bus.chain.logs import FailingLog, NamedFields
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message


def message(**values: Any) -> Message:
    return Message(1, "scan", json.dumps(values).encode(), sequence=3)


def named(before: Message, after: Message) -> NamedFields:
    return NamedFields(FailingLog((after,), {3: before}), registry=TypeRegistry())


def test_changed_lengths_are_fields_and_can_be_changed_back() -> None:
    fields = named(message(n=5, xs=[1, 2, 3, 4, 5]), message(n=5, xs=[1, 2]))
    length = fields.fields["scan:len(xs)"]
    assert (length.leaf.value, length.leaf.type, length.original) == (2, "uint16", 5)
    assert fields.fields["scan:n"].original is None
    (healed,) = fields.with_values({"scan:len(xs)": 5})
    assert json.loads(healed.payload) == {"n": 5, "xs": [1, 2, 2, 2, 2]}
    assert fields.with_values({name: field.leaf.value for name, field in fields.fields.items()})[0].payload == (
        fields.log.messages[0].payload
    )


def test_elements_that_are_cut_off_need_no_value() -> None:
    fields = named(message(xs=[1]), message(xs=[1, 2, 3, 4, 5, 6]))
    (found,) = fields.with_values({"scan:len(xs)": 1, "scan:xs[0]": 9, "scan:xs[3]": 7})
    assert json.loads(found.payload) == {"xs": [9]}
    (found,) = fields.with_values({"scan:xs[3]": 7, "scan:len(xs)": 5})
    assert json.loads(found.payload) == {"xs": [1, 2, 3, 7, 5]}


def test_lengths_that_were_not_changed_or_are_huge_are_no_fields() -> None:
    assert "scan:len(xs)" not in named(message(xs=[1, 2]), message(xs=[1, 3])).fields
    assert "scan:len(xs)" not in named(message(xs=[1]), message(xs=[1] * 70_000)).fields


def test_changed_elements_are_fields_wherever_they_stand() -> None:
    before = list(range(40))
    after = [*before[:35], -1, *before[36:]]
    fields = named(message(xs=before), message(xs=after))
    assert list(fields.fields) == ["scan:xs[0]", "scan:xs[1]", "scan:xs[2]", "scan:xs[3]", "scan:xs[35]"]
    assert fields.fields["scan:xs[35]"].original == 35
    (healed,) = fields.with_values({"scan:xs[35]": 35})
    assert json.loads(healed.payload) == {"xs": before}
