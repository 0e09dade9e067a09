"""The interceptor that records what it sees, at its place among the others."""

from __future__ import annotations

import logging
import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from riot_bus.log.writer import LogWriter

if TYPE_CHECKING:
    from riot_bus.message import Message
    from riot_bus.pipeline.event import Event
    from riot_bus.types.registry import TypeRegistry

__all__ = ["Record"]

_LOG = logging.getLogger(__name__)
_TICK_S = 0.25


@dataclass
class Record:
    """Record messages as they are at this place, before and after other interceptors.

    Args:
        path: The log to write.
        compression: zstd, lz4 or none.
        capacity: Most messages that wait to be written; more are counted as lost.
    """

    name: ClassVar[str] = "record"
    path: str
    compression: str = "zstd"
    capacity: int = 100_000

    def __post_init__(self) -> None:
        self.recorded = self.lost = 0
        self._registry: TypeRegistry | None = None
        self._waiting: deque[Message] = deque()
        self._bell = threading.Condition()
        self._stopping = False
        self._writer: LogWriter | None = None
        self._thread: threading.Thread | None = None

    def load(self, registry: TypeRegistry) -> None:
        """Take the registry that knows topics and types."""
        self._registry = registry

    def start(self) -> None:
        """Open the log."""
        self._stopping = False
        self._writer = LogWriter(self.path, registry=self._registry, compression=self.compression)
        self._thread = threading.Thread(target=self._run, name="riot-record", daemon=True)
        self._thread.start()

    def message(self, event: Event) -> None:
        """Queue it; never waits."""
        if self._thread is None or len(self._waiting) >= self.capacity:
            self.lost += 1
            return
        with self._bell:
            self._waiting.append(event.message)
            self._bell.notify()

    def stop(self) -> None:
        """Write what waits and finish the log."""
        with self._bell:
            self._stopping = True
            self._bell.notify()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._writer is not None:
            self._writer.close()
        if self.lost:
            _LOG.warning("%s lacks %d messages", self.path, self.lost)

    def _run(self) -> None:
        assert self._writer is not None
        while True:
            with self._bell:
                if not self._waiting and not self._stopping:
                    self._bell.wait(_TICK_S)
                if not self._waiting and self._stopping:
                    return
                batch = list(self._waiting)
                self._waiting.clear()
            written = 0
            try:
                for message in batch:
                    self._writer.write(message)
                    written += 1
                self._writer.tick()
            except Exception:
                _LOG.exception("%s cannot be written", self.path)
                self.lost += len(batch) - written
            self.recorded += written
