from __future__ import annotations

from riot_bus.log import layout
from riot_bus.log.log_channels import LogChannels
from riot_bus.types.json_type import JsonType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message


def test_a_channel_for_each_key_and_role() -> None:
    defined: list[bytes] = []
    table = LogChannels(None, lambda key: {"more": key}, defined.append)
    tracks = [table.open(Message(1, key, b""), role) for key, role in (("a", "delivered"), ("b", "delivered"))]
    tracks.append(table.open(Message(1, "a", b""), "original"))
    assert [each.number for each in tracks if each is not None] == [1, 2, 3]
    assert [each.topic for each in table.channels] == ["a", "b", "riot/original/a"]
    assert table.channels[1].metadata["more"] == "b"
    assert len(defined) == 3
    assert table.by_name({1: 5, 3: 2}) == {("a", "delivered"): 5, ("a", "original"): 2}
    table.renew("a")
    assert (table.known["delivered"].keys(), table.known["original"]) == ({"b"}, {})


def test_the_registry_knows_topic_and_type() -> None:
    registry = TypeRegistry(declared={"a/*": "json"})
    table = LogChannels(registry, None, lambda record: None)
    table.open(Message(1, "a/x", b"{}"), "delivered")
    table.open(Message(1, "b", b"{}", encoding="application/msgpack"), "delivered")
    first, second = table.channels
    assert (first.message_encoding, second.message_encoding) == ("json", "msgpack")
    assert first.metadata[layout.TOPIC] == "a/x"
    assert isinstance(registry.type_of("a/x"), JsonType)


def test_a_definition_is_written_once() -> None:
    from riot_bus.types.model import Schema

    class Registry(TypeRegistry):
        def type_of(self, key, **more):  # type: ignore[no-untyped-def]
            kind = JsonType()
            kind.schema = Schema("n", "jsonschema", b"{}")  # type: ignore[misc]
            return kind

    table = LogChannels(Registry(), None, lambda record: None)
    for key in ("a", "b"):
        table.open(Message(1, key, b"{}"), "delivered")
    assert [each.schema_id for each in table.channels] == [1, 1]
    assert [each.name for each in table.schemas] == ["n"]
