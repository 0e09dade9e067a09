from __future__ import annotations

from dataclasses import replace

import pytest
from mcap.records import Channel, Schema

from riot_bus.log import layout
from riot_bus.log.reader import channel_source
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_logtools.editing.channel_edit import Targets, new_identity

CHANNEL = Channel(id=3, topic="a", message_encoding="json", metadata={}, schema_id=2)
SCHEMA = Schema(id=2, data=b"{}", encoding="jsonschema", name="n")


def test_numbers_are_kept_where_they_are_free() -> None:
    targets = Targets()
    first = targets.open(CHANNEL, SCHEMA)
    assert (first.channel, first.schema, first.name) == (CHANNEL, SCHEMA, "a")
    assert targets.open(replace(CHANNEL, id=9), replace(SCHEMA, id=8)) is first
    other = targets.open(replace(CHANNEL, topic="b"), replace(SCHEMA, name="m"))
    assert (other.channel.id, other.channel.schema_id) == (1, 1)
    assert targets.open(replace(CHANNEL, topic="c"), None).channel.schema_id == 0
    assert first.definition().startswith(b"\3")


def test_another_name_is_another_key() -> None:
    own = replace(CHANNEL, metadata={layout.KEY: "a", layout.TOPIC: "a", layout.ROLE: "original"})
    topic = channel_source(own, None).recorded(own.metadata)
    found = new_identity(own, topic, "/b/c", [])
    assert (found.topic, found.metadata[layout.KEY]) == ("riot/original/b/c", "b/c")
    with pytest.raises(ConfigError, match="cannot be the name"):
        new_identity(own, topic, "b/**", [])


def test_topics_of_a_bag_keep_their_slash() -> None:
    bag = replace(CHANNEL, topic="/a")
    topic = channel_source(bag, None).recorded({})
    assert new_identity(bag, topic, "b", []).topic == "/b"
