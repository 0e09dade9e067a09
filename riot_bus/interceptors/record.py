"""The interceptor that records what it sees, at its place among the others."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from riot_bus.interceptors.recorder import FINISH_S, Recorder
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.pipeline.runner import BoundedCounts
from riot_bus.vocabulary.errors import ConfigError, DataLossError

if TYPE_CHECKING:
    from riot_bus.pipeline.event import Event
    from riot_bus.types.registry import TypeRegistry


@dataclass
class Record:
    """Record messages as they are at this place, before and after other interceptors.

    The file is written on a thread of its own. A message that does not fit in the queue is passed on but not recorded:
    it is counted in `lost`, and the loss is an error of this interceptor.

    Args:
        path: The log to write; an existing file is overwritten.
        compression: zstd, lz4 or none.
        capacity: Most messages that wait to be written.
        capacity_bytes: Most payload bytes that wait to be written.
    """

    name: ClassVar[str] = "record"
    path: Path
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    capacity: int = 100_000
    capacity_bytes: int = 1 << 27

    def __post_init__(self) -> None:
        if self.capacity < 1 or self.capacity_bytes < 1:
            raise ConfigError("capacity and capacity_bytes must be 1 or more")
        self._registry: TypeRegistry | None = None
        self._recorder: Recorder | None = None
        self._unopened = BoundedCounts()
        self._open = self._told = False

    @property
    def recorded(self) -> int:
        """Number of messages written."""
        return 0 if self._recorder is None else sum(self._recorder.recorded.values())

    @property
    def lost(self) -> Counter[str]:
        """Messages by topic that did not fit or could not be written."""
        return self._unopened if self._recorder is None else self._recorder.lost

    def load(self, registry: TypeRegistry) -> None:
        """Set the registry that knows topics and types."""
        self._registry = registry

    def start(self) -> None:
        """Open the log."""
        writer = LogWriter(self.path, LogSettings(compression=self.compression), registry=self._registry)
        topic = str if self._registry is None else self._registry.topic
        self._recorder = Recorder(writer, capacity=self.capacity, capacity_bytes=self.capacity_bytes, topic=topic)
        self._open, self._told = True, False

    def message(self, event: Event) -> None:
        """Queue it; never waits.

        Raises:
            DataLossError: At the first loss, so that it is seen while it happens.
        """
        if self._recorder is None:
            self._unopened.add(event.topic)
        elif self._open:
            self._recorder.delivered(event.message)
        if not self._told and (self._recorder is None or self._recorder.lossy):
            self._told = True
            text = "messages are not recorded"
            raise DataLossError(text, where=str(self.path), hint="is the disk full, or too slow?")

    def stop(self) -> None:
        """Write the queued messages and finish the log.

        Raises:
            DataLossError: The log lacks messages.
        """
        self._open = False
        if self._recorder is not None and not self._recorder.close(FINISH_S):
            raise DataLossError(f"the log is still not written after {FINISH_S:g} s", where=str(self.path))
        if lost := self.lost:
            topics = ", ".join(f"{topic} {number}" for topic, number in lost.most_common(5))
            raise DataLossError(f"the log lacks {lost.total()} messages: {topics}", where=str(self.path))
