"""What is in a log, at a glance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.log.reader import LogReader, Loss

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["LogInfo", "TopicInfo", "log_info"]


@dataclass(slots=True)
class TopicInfo:
    """One topic of a log."""

    topic: str
    key: str
    type: str
    encoding: str
    count: int = 0
    originals: int = 0
    bytes: int = 0
    first: int = 0
    last: int = 0

    @property
    def rate(self) -> float:
        """Messages per second over the topic's own duration, 0 if it cannot be told."""
        return (self.count - 1) * 1e9 / (self.last - self.first) if self.last > self.first else 0.0


@dataclass(frozen=True, slots=True)
class LogInfo:
    """A whole log."""

    path: str
    size: int
    profile: str
    topics: tuple[TopicInfo, ...]
    count: int
    start: int | None
    end: int | None
    metadata: dict[str, str]
    loss: Loss

    @property
    def seconds(self) -> float:
        """Time from the first to the last message."""
        return (self.end - self.start) / 1e9 if self.start is not None and self.end is not None else 0.0


def log_info(path: Path | str) -> LogInfo:
    """Read a log from end to end and count; so the loss is the whole truth."""
    with LogReader(path) as reader:
        topics: dict[str, TopicInfo] = {}
        for topic, key, schema, encoding in reader.channels():
            topics.setdefault(key, TopicInfo(topic, key, schema.name, encoding))
        for message in reader.messages():
            topic_info = topics[message.key]
            if topic_info.count == 0:
                topic_info.first = message.time
            topic_info.count += 1
            topic_info.bytes += len(message.payload)
            topic_info.last = message.time
        for message in reader.originals():
            topics[message.key].originals += 1
        for _ in reader.provenance():
            pass  # so that damaged notes are counted
        filled = [each for each in topics.values() if each.count]
        return LogInfo(
            path=str(path),
            size=reader.size,
            profile=reader.profile,
            topics=tuple(sorted(topics.values(), key=lambda each: (each.topic, each.key))),
            count=sum(each.count for each in filled),
            start=min((each.first for each in filled), default=None),
            end=max((each.last for each in filled), default=None),
            metadata=dict(reader.metadata),
            loss=reader.loss,
        )
