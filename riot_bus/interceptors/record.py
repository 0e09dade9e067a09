"""The interceptor that records what it sees, at its place among the others."""

from __future__ import annotations

import logging
import threading
from collections import Counter, deque
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from riot_bus.log.writer import LogWriter
from riot_bus.pipeline.runner import MOST_TOPICS, OTHER_TOPICS
from riot_bus.vocabulary.errors import ConfigError, DataLossError

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.pipeline.event import Event
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

__all__ = ["Record"]

_LOG = logging.getLogger(__name__)
_TICK_S = 0.25  # without messages, an old chunk ends this much late at most
_JOIN_S = 60.0  # enough for 128 MiB (default of `capacity_bytes`) at 2.3 MB/s
_OVERHEAD_BYTES = 256  # a queued `Message`, its tuple, its integers and its payload's header take about this


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
        self.recorded = 0
        self.lost: Counter[str] = Counter()
        """Messages by topic that did not fit or could not be written."""
        self._registry: TypeRegistry | None = None
        self._waiting: deque[tuple[str, Message]] = deque()
        self._bytes = 0
        self._bell = threading.Condition()
        self._stopping = self._told = False
        self._thread: threading.Thread | None = None

    def load(self, registry: TypeRegistry) -> None:
        """Set the registry that knows topics and types."""
        self._registry = registry

    def start(self) -> None:
        """Open the log."""
        writer = LogWriter(self.path, registry=self._registry, compression=self.compression)
        self._stopping = self._told = False
        self._thread = threading.Thread(target=self._run, args=(writer,), name="riot-record", daemon=True)
        self._thread.start()

    def message(self, event: Event) -> None:
        """Queue it; never waits.

        Raises:
            DataLossError: At the first loss, so that it is seen while it happens.
        """
        size = len(event.payload) + _OVERHEAD_BYTES
        with self._bell:
            room = len(self._waiting) < self.capacity and self._bytes + size <= self.capacity_bytes
            if room and self._thread is not None:
                self._waiting.append((event.topic, event.message))
                self._bytes += size
                self._bell.notify()
            else:
                self._lose(event.topic)
            if not self.lost or self._told:
                return
            self._told = True
        raise DataLossError("messages are not recorded", where=str(self.path), hint="is the disk full, or too slow?")

    def stop(self) -> None:
        """Write the queued messages and finish the log.

        Raises:
            DataLossError: The log lacks messages.
        """
        with self._bell:
            self._stopping = True
            self._bell.notify()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(_JOIN_S)
            if thread.is_alive():
                raise DataLossError(f"the log is still not written after {_JOIN_S:g} s", where=str(self.path))
        if self.lost:
            topics = ", ".join(f"{topic} {number}" for topic, number in self.lost.most_common(5))
            raise DataLossError(f"the log lacks {self.lost.total()} messages: {topics}", where=str(self.path))

    def _lose(self, topic: str, number: int = 1) -> None:
        self.lost[topic if topic in self.lost or len(self.lost) < MOST_TOPICS else OTHER_TOPICS] += number

    def _run(self, writer: LogWriter) -> None:
        while True:
            with self._bell:
                if not self._waiting and not self._stopping:
                    self._bell.wait(_TICK_S)
                if not self._waiting and self._stopping:
                    break
                batch = [self._waiting.popleft() for _ in range(min(len(self._waiting), 1000))]
                self._bytes -= sum(len(message.payload) + _OVERHEAD_BYTES for _, message in batch)
            for topic, message in batch:
                self._write(writer, topic, message)
            self._guard(writer.tick)
        self._guard(writer.close)
        with self._bell:
            for topic, number in writer.lost.items():
                self.recorded -= number
                self._lose(topic, number)

    def _write(self, writer: LogWriter, topic: str, message: Message) -> None:
        if self._guard(lambda: writer.write(message)):
            self.recorded += 1
        else:
            with self._bell:
                self._lose(topic)

    def _guard(self, action: Callable[[], None]) -> bool:
        try:
            action()
        except Exception:
            if not self.lost:
                _LOG.exception("%s cannot be written", self.path)
            return False
        return True
