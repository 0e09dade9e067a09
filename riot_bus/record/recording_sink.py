"""What both destinations of a recording have in common: a writer, counts of losses, and tracks that may be outdated."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from riot_bus.log.writer import LogWriter, LostMessagesError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from riot_bus.log.engine.chunk import Row
    from riot_bus.record.losses import LossCounts
    from riot_bus.record.naming import Naming
    from riot_bus.record.options import CaptureOptions
    from riot_bus.types.registry import TypeRegistry


class RecordingSink:
    """Base of the destinations of a recording; thread-safe if `lock` is held where this is required.

    Args:
        options: Limits of files and chunks.
        registry: Names and types of topics.
        naming: Names for the files.
        metadata: Function that returns the metadata of each file.
        details: Function that returns more metadata of a key's channel.
        profile: MCAP profile.
        warn: Function that receives each warning as one line.

    Attributes:
        lock: Lock that a caller holds from asking for tracks to appending.
        generation: Number that grows when earlier tracks become invalid: with another file, or a type that is learnt.
        writer: Writer that messages are appended to at present.
        counts: Counts of these messages.
    """

    writer: LogWriter
    counts: LossCounts

    def __init__(
        self,
        options: CaptureOptions,
        *,
        registry: TypeRegistry,
        naming: Naming,
        metadata: Callable[[], Mapping[str, str]],
        details: Callable[[str], Mapping[str, str]],
        profile: str,
        warn: Callable[[str], None],
    ) -> None:
        self.lock = threading.RLock()
        self.generation = 0
        self._options, self._registry, self._naming = options, registry, naming
        self._metadata, self._details, self._profile, self._warn = metadata, details, profile, warn

    def append(self, rows: Sequence[Row], *, patient: bool) -> None:
        """Write messages, with the lock held; lost ones are counted."""
        try:
            self.writer.append(rows, patient=patient)
        except LostMessagesError as error:
            self._failed(error)

    def renew(self, key: str) -> None:
        """Record further messages of a key with its type, which has become known."""
        with self.lock:
            self.writer.renew(key)
            self.generation += 1

    def _new_writer(self, path: Path | str, **settings: Any) -> LogWriter:
        options = self._options
        return LogWriter(
            path,
            registry=self._registry,
            chunk_bytes=options.chunk_bytes,
            channel_metadata=self._details,
            threaded=True,
            queue_bytes=options.queue_bytes,
            **settings,
        )

    def _failed(self, error: LostMessagesError) -> None:
        """Count the messages that a writer has lost; called with the lock."""
        self._count_lost(self.counts, error)

    def _count_lost(self, counts: LossCounts, error: LostMessagesError) -> None:
        for reason, lost in error.reasons.items():
            for (key, _), number in lost.items():
                counts.lose(reason, self._registry.topic(key), number, written=True)
