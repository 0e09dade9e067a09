"""What a log says of its topics, and from when to when it goes; as much as a player wants to know."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.log import layout
from riot_bus.types.model import Schema
from riot_bus.types.offer import RecordedTopic

if TYPE_CHECKING:
    from riot_bus.log.reader import LogReader

__all__ = ["recorded_topics", "span_of"]


def recorded_topics(reader: LogReader) -> list[RecordedTopic]:
    """Return the topics of the delivered messages; a topic of several channels once, as its first one says."""
    found: dict[str, RecordedTopic] = {}
    for channel in reader._channels.values():  # its public view lacks the metadata
        metadata = channel.metadata
        if metadata.get(layout.ROLE) == "original":
            continue
        record = reader._scan.schemas.get(channel.schema_id)
        schema = Schema(record.name, record.encoding, record.data) if record else Schema("", "", b"")
        key = metadata.get(layout.KEY, channel.topic)
        name = metadata.get(layout.TOPIC, channel.topic)
        topic = RecordedTopic(name, key, layout.KEY in metadata, schema, channel.message_encoding, dict(metadata))
        found.setdefault(key, topic)
    return list(found.values())


def span_of(reader: LogReader) -> tuple[int, int]:
    """Return the time of the first message and about that of the last one, without reading all; 0, 0 if it is empty."""
    first = next((message.time for message in reader.messages()), 0)
    last = max((block.end for block in reader._scan.blocks), default=0)
    return first, max(first, last)
