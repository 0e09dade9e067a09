"""What a log says of its topics, and from when to when it goes; as much as a player wants to know."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from riot_bus.log.reader import LogReader
    from riot_bus.types.capabilities import RecordedTopic

__all__ = ["recorded_topics", "span_of"]


def recorded_topics(reader: LogReader) -> list[RecordedTopic]:
    """Return the topics of the delivered messages; a topic of several channels once, as its first one says."""
    found: dict[str, RecordedTopic] = {}
    for topic in reader.recorded():
        found.setdefault(topic.key, topic)
    return list(found.values())


def span_of(reader: LogReader) -> tuple[int, int] | None:
    """Return the time of the first message and about that of the last one, without reading all; None if it is empty."""
    first = next((message.time for message in reader.messages()), None)
    return None if first is None else (first, max(first, reader.latest))
