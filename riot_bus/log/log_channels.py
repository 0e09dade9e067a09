"""The channels and schemas of a log that is being written: one channel for each key and role."""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

from mcap.records import Channel, Schema

from riot_bus.log import layout
from riot_bus.log.engine.mcap_file import record_bytes
from riot_bus.log.layout import Constants, Role

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.types.model import Schema as Definition
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

_MAX_CHANNELS = 65_000  # just below what the 16 bits of MCAP's channel numbers allow
_TYPE_HASH = re.compile(r"RIHS01_[0-9a-f]{64}")
# Integers, not names: readers of every ROS 2 release understand them (metadata version 8).
_DEFAULT_QOS = """- history: 1
  depth: 10
  reliability: 1
  durability: 2
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: 1
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false
"""
_MESSAGE_ENCODINGS = {"application/json": "json", "text/json": "json", "application/msgpack": "msgpack"}


class ChannelWriter(NamedTuple):
    """What a writer needs to know about a channel: its number, and what its messages have in common."""

    number: int
    constants: Constants


class LogChannels:
    """Opens channels, and knows those that are open.

    Args:
        registry: Names and types of topics; without one, topics are keys and types unknown.
        details: Function called once per key for more channel metadata, such as `offered_qos_profiles`.
        define: Function called with each new record of a schema or channel.

    Attributes:
        known: Channels by role and key.
        channels: Records of all channels, in the order of their numbers.
    """

    def __init__(
        self,
        registry: TypeRegistry | None,
        details: Callable[[str], Mapping[str, str]] | None,
        define: Callable[[bytes], None],
    ) -> None:
        self.known: dict[Role, dict[str, ChannelWriter]] = {"delivered": {}, "original": {}}
        self.channels: list[Channel] = []
        self._names: list[tuple[str, Role]] = []
        self._schemas: dict[tuple[str, bytes], Schema] = {}
        self._registry, self._details, self._define = registry, details, define

    @property
    def schemas(self) -> list[Schema]:
        """Records of all schemas."""
        return list(self._schemas.values())

    def by_name(self, counts: Mapping[int, int]) -> Counter[tuple[str, Role]]:
        """Return numbers of messages by key and role, given those by channel."""
        return Counter({self._names[channel - 1]: count for channel, count in counts.items()})

    def renew(self, key: str) -> None:
        """Let further messages of a key open new channels."""
        for known in self.known.values():
            known.pop(key, None)

    def open(self, message: Message, role: Role) -> ChannelWriter | None:
        """Open a channel for messages like this one; None if the file can hold no more."""
        if len(self.channels) >= _MAX_CHANNELS:
            return None
        key, registry = message.key, self._registry
        topic, schema = key, None
        encoding = _MESSAGE_ENCODINGS.get(message.encoding, message.encoding)
        if registry is not None:
            topic = registry.topic(key)
            kind = registry.type_of(key, payload=message.payload, encoding=message.encoding)
            if kind is not None:
                schema, encoding = kind.schema, kind.encoding
            elif (adapter := registry.metadata_adapter(key)) is not None:
                schema, encoding = adapter.definition(key) or (None, encoding)
        constants = Constants.of(message)
        metadata = {layout.KEY: key, layout.TOPIC: topic, layout.ROLE: role, **constants.to_metadata()}
        if encoding == "cdr":
            found = _TYPE_HASH.search(key)
            metadata |= {"offered_qos_profiles": _DEFAULT_QOS, "topic_type_hash": found.group() if found else ""}
        if self._details is not None:
            metadata |= self._details(key)
        channel = Channel(
            id=len(self.channels) + 1,
            topic=layout.channel_name(topic, role),
            message_encoding=encoding,
            metadata=metadata,
            schema_id=self._schema_id(schema),
        )
        self.channels.append(channel)
        self._names.append((key, role))
        self._define(record_bytes(channel))
        track = self.known[role][key] = ChannelWriter(channel.id, constants)
        return track

    def _schema_id(self, schema: Definition | None) -> int:
        if schema is None:
            return 0
        identity = (schema.name, schema.data)
        found = self._schemas.get(identity)
        if found is None:
            number = len(self._schemas) + 1
            found = Schema(id=number, data=schema.data, encoding=schema.encoding, name=schema.name)
            self._schemas[identity] = found
            self._define(record_bytes(found))
        return found.id
