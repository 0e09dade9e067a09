"""Fields of a short log: lengths that an injection has changed are fields like others."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

import pytest

from riot_bus.chain.base.logs import FailingLog, NamedFields, internal_name, nominal_values, read_messages
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
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


def test_messages_of_one_topic_are_numbered_and_their_fields_have_one_name_on_the_bus() -> None:
    log = FailingLog((message(n=1), message(n=2).with_(sequence=4), Message(1, "other", b'{"m": 3}', sequence=5)), {})
    fields = NamedFields(log, registry=TypeRegistry())
    assert list(fields.fields) == ["scan[0]:n", "scan[1]:n", "other:m"]
    assert [internal_name(name) for name in fields.fields] == ["scan:n", "scan:n", "other:m"]
    assert [json.loads(each.payload) for each in fields.with_values({"scan[1]:n": 7})] == [{"n": 1}, {"n": 7}, {"m": 3}]
    with pytest.raises(ConfigError, match="no field 'scan:n'"):
        fields.with_values({"scan:n": 7})


def test_messages_that_follow_a_log_get_the_next_numbers() -> None:
    log = FailingLog((message(n=1).with_(sequence=7), message(n=2).with_(sequence=3)), {3: message(n=0)})
    more = log.followed_by([message(n=3), message(n=4)])
    assert [one.sequence for one in more.messages] == [7, 3, 8, 9]
    assert more.originals == log.originals


def test_what_has_no_fields_is_left_out() -> None:
    odd = (
        message(n=1).with_(kind="delete"),
        Message(1, "scan", b"{", sequence=4),
        Message(1, "blob", b"\x00", encoding="application/octet-stream", sequence=5),
    )
    assert NamedFields(FailingLog(odd, {}), registry=TypeRegistry()).fields.keys() <= {"blob:"}


def test_a_field_that_the_original_did_not_have_has_no_original_value() -> None:
    assert named(message(n=5), message(n=5, extra=2)).fields["scan:extra"].original is None


def test_nominal_values_leave_out_what_cannot_be_read() -> None:
    log = [message(n=1), message(m=1), Message(1, "blob", b"\x00", encoding="x/y"), message(n=3)]
    paths = {"scan": ["n"], "blob": ["n"], "none": ["n"]}
    assert nominal_values(log, paths, registry=TypeRegistry()) == {"scan:n": [1, 3], "blob:n": [], "none:n": []}


def test_a_damaged_log_is_read_as_far_as_it_goes_and_said_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path, LogSettings(chunk_bytes=1000)) as writer:
        for number in range(300):
            writer.write(message(n=number))
    path.write_bytes(path.read_bytes()[:-3000])
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            assert 0 < len(read_messages(path, registry=TypeRegistry())) < 300
    assert caplog.text.count("is damaged") == 1


def test_what_was_delayed_is_restored_to_its_place() -> None:
    config, arm = Message(10, "config", b"{}", sequence=1), Message(20, "arm", b"{}", sequence=2)
    late = FailingLog((arm, config.with_(time=30)), {1: config})
    assert late.restored().messages == (config, arm)
