"""Which channels selected fields come from; the log is a fake."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from riot_bus.log.layout import Constants, Role
from riot_bus.log.reader import ChannelSource
from riot_bus.log.tables import plan
from riot_bus.log.tables.plan import Feed, chosen_rows, delivered_sources, log_registry, plan_columns, topic_types
from riot_bus.types.json_type import JsonType
from riot_bus.types.model import Schema
from riot_bus.types.payloads import Payloads
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.predicate import parse_predicate


def source(topic: str, *, role: Role = "delivered", schema: str = "", encoding: str = "json") -> ChannelSource:
    return ChannelSource(topic.strip("/"), topic, role, True, Constants(), Schema(schema, "", b""), encoding)


class Reader:
    """A log with these channels, numbered from 1, and these messages."""

    path = "a.mcap"

    def __init__(self, *sources: ChannelSource, messages: list[tuple[str, bytes]] | None = None) -> None:
        self._sources = dict(enumerate(sources, 1))
        self._messages = [Message(at, key, payload) for at, (key, payload) in enumerate(messages or [])]

    def sources(self) -> dict[int, ChannelSource]:
        return self._sources

    def messages(self, *, topics: list[str]) -> list[Message]:
        return [each for each in self._messages if each.key in topics]


def log(*sources: ChannelSource, messages: list[tuple[str, bytes]] | None = None) -> Any:
    return Reader(*sources, messages=messages)


def payloads(*found: bytes) -> Payloads:
    lengths = [len(each) for each in found]
    return Payloads(b"".join(found), np.cumsum([0, *lengths])[:-1], np.array(lengths, np.int64))


TWO = log(source("/a"), source("/b"), source("/a", role="original"), source("/a"))


def test_each_field_comes_from_all_channels_of_its_topic_as_delivered() -> None:
    wishes, feeds = plan_columns(TWO, ["/a:x", "/b:y", "/a:z where x > 1", "/a:x"], TypeRegistry())
    assert [(each.topic, each.path, each.where is not None) for each in wishes] == [
        ("/a", "x", False),
        ("/b", "y", False),
        ("/a", "z", True),
    ]
    assert sorted((feed.number, feed.wishes) for feed in feeds) == [(1, [0, 2]), (2, [1]), (4, [0, 2])]
    assert all(isinstance(feed.kind, JsonType) for feed in feeds)


@pytest.mark.parametrize(
    ("selectors", "message", "hint"),
    [
        ([], "no field is wanted", "name at least one"),
        (["/a"], "'/a' names no field", "write '/a:FIELD'"),
        (["/a:v[*]"], "names many fields", "ranges[3]"),
        (["/bb:x"], "no topic '/bb' in the log", "'/b'"),
    ],
)
def test_what_cannot_be_planned_is_refused(selectors: list[str], message: str, hint: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        plan_columns(TWO, selectors, TypeRegistry())
    assert hint in str(caught.value.hint)


def test_a_type_without_definition_is_refused_unless_another_channel_has_one() -> None:
    unknown = source("/a", schema="pkg/Secret", encoding="secret")
    with pytest.raises(ConfigError, match="type 'pkg/Secret' of '/a' is not known"):
        plan_columns(log(unknown), ["/a:x"], TypeRegistry())
    _, feeds = plan_columns(log(unknown, source("/a")), ["/a:x"], TypeRegistry())
    assert [feed.number for feed in feeds] == [2]
    _, feeds = plan_columns(log(source("/a", encoding="")), ["/a:x"], TypeRegistry())
    assert [feed.kind for feed in feeds] == [None]  # payloads may show it


def test_payloads_show_a_type_that_nothing_names() -> None:
    feed = Feed(1, source("/a", encoding=""))
    registry = TypeRegistry()
    assert feed.settle(payloads(), registry) is None
    assert feed.settle(payloads(b"\x01raw"), registry) is None
    assert isinstance(feed.settle(payloads(b"\x01raw", b'{"x": 1}'), registry), JsonType)
    assert isinstance(feed.settle(payloads(), registry), JsonType)


def test_channels_are_those_of_delivered_messages_of_existing_topics() -> None:
    assert list(delivered_sources(TWO, TypeRegistry())) == [1, 2, 4]
    assert list(delivered_sources(TWO, TypeRegistry(), ["/b", "/*"])) == [1, 2, 4]
    assert list(delivered_sources(TWO, TypeRegistry(), ["b"])) == [2]
    with pytest.raises(ConfigError, match="no topic '/c' in the log") as caught:
        delivered_sources(TWO, TypeRegistry(), ["/b", "/c"])
    assert caught.value.where == "a.mcap"


def test_fields_of_a_topic_are_those_of_its_first_messages() -> None:
    first = [("a", json.dumps({"x": 1, "v": [{"n": 1}, {"n": 2}]}).encode()), ("a", b"broken"), ("a", b'{"y": "t"}')]
    reader = log(source("/b", encoding=""), source("/a"), source("/c", schema="S", encoding="s"), messages=first)
    topics = dict(topic_types(reader, TypeRegistry()))
    assert list(topics) == ["/a", "/b", "/c"]
    assert {each.path: each.type for each in topics["/a"].fields} == {
        "x": "int64",
        "len(v)": "uint32",
        "v[*].n": "int64",
        "y": "string",
    }
    assert (topics["/b"].name, topics["/b"].problem) == ("", "")
    assert (topics["/c"].name, topics["/c"].problem) == ("S", "no definition")
    (opaque,) = topic_types(log(source("/a"), messages=[("a", b"broken")]), TypeRegistry())
    assert opaque[1].problem.startswith("opaque: ")


def test_a_registry_knows_what_delivered_channels_define(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "load_adapters", list)
    definition = json.dumps({"type": "object"}).encode()
    delivered = ChannelSource(
        "a", "/a", "delivered", True, Constants(), Schema("Pose", "jsonschema", definition), "json"
    )
    original = ChannelSource("b", "/b", "original", True, Constants(), Schema("Pose", "jsonschema", definition), "json")
    registry = log_registry(log(delivered, original))
    assert registry.type_of("a") is not None
    assert registry.type_of("b") is None


def test_rows_that_lack_a_field_do_not_meet_a_predicate() -> None:
    rows = payloads(b'{"x": 1, "on": true}', b'{"x": 3}', b"broken", b'{"x": 3, "on": true}')
    chosen = chosen_rows(JsonType(), rows, parse_predicate("x > 2 and on == true"))
    assert chosen.tolist() == [False, False, False, True]
    assert chosen_rows(JsonType(), rows, parse_predicate("x < 2 or x > 2")).tolist() == [True, True, False, True]
    assert chosen_rows(JsonType(), payloads(), parse_predicate("x > 2")).tolist() == []
