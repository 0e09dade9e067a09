"""Returns the topics and the time span of a log, as a player needs them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from riot_bus.log.reader import LogReader
    from riot_bus.types.capabilities import RecordedTopic

__all__ = ["recorded_topics", "span_of"]


def recorded_topics(reader: LogReader) -> list[RecordedTopic]:
    """Return the topics of the delivered messages; if a topic has several channels, the first one counts."""
    found: dict[str, RecordedTopic] = {}
    for topic in reader.recorded():
        found.setdefault(topic.key, topic)
    return list(found.values())


def span_of(reader: LogReader) -> tuple[int, int] | None:
    """Return the times of the first and (roughly) the last message, without reading all; None for an empty log."""
    first = next((message.time for message in reader.messages()), None)
    return None if first is None else (first, max(first, reader.latest))
