"""Defines the channels of the output: those of the inputs, unless something has to be different."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from riot_bus.log import layout
from riot_bus.log.engine.blocks import NUMBERS
from riot_bus.log.engine.mcap_file import record_bytes
from riot_bus.log.reader import ChannelSource, channel_source
from riot_bus.types.capabilities import PublishesAs
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mcap.records import Channel, Schema

    from riot_bus.types.capabilities import RecordedTopic
    from riot_bus.types.model import Adapter

_NO_KEY = re.compile(r"\A\Z|//|[*$?#\s]")


@dataclass(frozen=True, slots=True, eq=False)
class OutputChannel:
    """A channel of the output."""

    channel: Channel
    schema: Schema | None
    source: ChannelSource

    @property
    def name(self) -> str:
        """Name of its topic shown to users."""
        return self.source.topic

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
        """Return a channel of the output; the same one for equal definitions."""
        own_schema = None if schema is None else self._schema(schema)
        number = 0 if own_schema is None else own_schema.id
        identity = channel.topic, channel.message_encoding, frozenset(channel.metadata.items()), number
        found = self._known.get(identity)
        if found is None:
            record = replace(channel, id=_free(channel.id, self._channel_numbers), schema_id=number)
            found = self._known[identity] = OutputChannel(record, own_schema, channel_source(record, own_schema))
        return found

    def _schema(self, schema: Schema) -> Schema:
        identity = schema.name, schema.encoding, schema.data
        found = self._schemas.get(identity)
        if found is None:
            found = self._schemas[identity] = replace(schema, id=_free(schema.id, self._schema_numbers))
        return found


def new_identity(channel: Channel, topic: RecordedTopic, name: str, adapters: Sequence[Adapter]) -> Channel:
    """Return a channel under another name.

    Raises:
        ConfigError: No topic can have this name.
    """
    if not topic.keyed:
        new = name if name.startswith("/") or not topic.name.startswith("/") else f"/{name}"
        return replace(channel, topic=new)
    key = _new_key(topic, name, adapters)
    shown = next((found.name for each in adapters if (found := each.topic(key)) is not None), key)
    metadata = {**channel.metadata, layout.KEY: key, layout.TOPIC: shown}
    original = metadata.get(layout.ROLE) == "original"
    return replace(channel, topic=layout.ORIGINAL_PREFIX + shown.lstrip("/") if original else shown, metadata=metadata)


def _new_key(topic: RecordedTopic, name: str, adapters: Sequence[Adapter]) -> str:
    for adapter in adapters:
        offer = adapter.offer(topic, name=name, domain=None) if isinstance(adapter, PublishesAs) else None
        if offer is not None:
            return offer.key
    key = name.strip("/")
    if _NO_KEY.search(key):
        raise ConfigError(
            f"{name!r} cannot be the name of a topic", where="--remap", hint="give it one without wildcards"
        )
    return key


def _free(wish: int, taken: set[int]) -> int:
    number = wish
    if number in taken or not 0 <= number < NUMBERS:
        number = next((each for each in range(1, NUMBERS) if each not in taken), -1)
        if number < 0:
            raise ConfigError(f"more than {NUMBERS - 1} channels do not fit into one log", hint="merge fewer logs")
    taken.add(number)
    return number
