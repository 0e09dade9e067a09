"""The channels of the output: those of the inputs, unless something has to be different."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mcap.records import Channel, Schema

from riot_bus.log import layout
from riot_bus.log.engine.mcap_file import record_bytes
from riot_bus.log.layout import Constants, Role
from riot_bus.types.capabilities import PublishesAs
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.types.capabilities import RecordedTopic
    from riot_bus.types.model import Adapter

__all__ = ["OutputChannel", "Targets", "new_identity"]

_NUMBERS = 1 << 16  # MCAP's numbers of channels and schemas have 16 bits
_NO_KEY = re.compile(r"\A\Z|//|[*$?#\s]")


@dataclass(frozen=True, slots=True, eq=False)
class OutputChannel:
    """A channel of the output.

    Attributes:
        channel: Record of the channel.
        schema: Record of its schema, None if it has none.
        key: Key of its messages.
        name: Name of its topic shown to users.
        role: Whether it holds originals.
        own: Whether it has the metadata that riot_bus writes.
        constants: Properties that its messages have in common.
    """

    channel: Channel
    schema: Schema | None
    key: str
    name: str
    role: Role
    own: bool
    constants: Constants

    def definition(self) -> bytes:
        """Return the records that define the channel."""
        schema = record_bytes(self.schema) if self.schema is not None else b""
        return schema + record_bytes(self.channel)


class Targets:
    """Assigns numbers to channels and schemas, the same as in the input if these are free."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str, frozenset[tuple[str, str]], int], OutputChannel] = {}
        self._schemas: dict[tuple[str, str, bytes], Schema] = {}
        self._channel_numbers: set[int] = set()
        self._schema_numbers: set[int] = {0}

    def open(self, channel: Channel, schema: Schema | None) -> OutputChannel:
        """Return a channel of the output; the same one for equal definitions.

        Args:
            channel: Definition of the channel; its number is used if it is free.
            schema: Schema of the channel; its number is used if it is free.
        """
        own_schema = None if schema is None else self._schema(schema)
        number = 0 if own_schema is None else own_schema.id
        identity = channel.topic, channel.message_encoding, frozenset(channel.metadata.items()), number
        found = self._known.get(identity)
        if found is None:
            metadata = channel.metadata
            role: Role = "original" if metadata.get(layout.ROLE) == "original" else "delivered"
            record = Channel(
                id=_free(channel.id, self._channel_numbers),
                topic=channel.topic,
                message_encoding=channel.message_encoding,
                metadata=metadata,
                schema_id=number,
            )
            found = self._known[identity] = OutputChannel(
                record,
                own_schema,
                metadata.get(layout.KEY, channel.topic),
                metadata.get(layout.TOPIC, channel.topic),
                role,
                layout.KEY in metadata,
                Constants.from_metadata(metadata),
            )
        return found

    def _schema(self, schema: Schema) -> Schema:
        identity = schema.name, schema.encoding, schema.data
        found = self._schemas.get(identity)
        if found is None:
            number = _free(schema.id, self._schema_numbers)
            found = self._schemas[identity] = Schema(
                id=number, data=schema.data, encoding=schema.encoding, name=schema.name
            )
        return found


def new_identity(channel: Channel, topic: RecordedTopic, name: str, adapters: Sequence[Adapter]) -> Channel:
    """Return a channel under another name.

    Args:
        channel: The channel as it was read.
        topic: Topic that is recorded in it.
        name: New name of the topic.
        adapters: Adapters that are asked for the key.

    Raises:
        ConfigError: No topic can have this name.
    """
    metadata: dict[str, str] = dict(channel.metadata)
    if not topic.keyed:
        new = name if name.startswith("/") or not topic.name.startswith("/") else f"/{name}"
        return _renamed(channel, new, metadata)
    key = _new_key(topic, name, adapters)
    shown = next((found.name for each in adapters if (found := each.topic(key)) is not None), key)
    metadata |= {layout.KEY: key, layout.TOPIC: shown}
    original = metadata.get(layout.ROLE) == "original"
    return _renamed(channel, layout.ORIGINAL_PREFIX + shown.lstrip("/") if original else shown, metadata)


def _new_key(topic: RecordedTopic, name: str, adapters: Sequence[Adapter]) -> str:
    for adapter in adapters:
        offer = adapter.offer(topic, name=name, domain=None) if isinstance(adapter, PublishesAs) else None
        if offer is not None:
            return offer.key
    key = name.strip("/")
    if _NO_KEY.search(key):
        raise ConfigError(f"{name!r} is no name of a topic", where="--remap", hint="give it one without wildcards")
    return key


def _renamed(channel: Channel, topic: str, metadata: Mapping[str, str]) -> Channel:
    return Channel(
        id=channel.id,
        topic=topic,
        message_encoding=channel.message_encoding,
        metadata=dict(metadata),
        schema_id=channel.schema_id,
    )


def _free(wish: int, taken: set[int]) -> int:
    number = wish
    if number in taken or not 0 <= number < _NUMBERS:
        number = next((each for each in range(1, _NUMBERS) if each not in taken), -1)
        if number < 0:
            raise ConfigError(f"more than {_NUMBERS - 1} channels do not fit into one log", hint="merge fewer logs")
    taken.add(number)
    return number
