"""What both destinations of a recording have in common: what is written to, and tracks that may be outdated."""

from __future__ import annotations

import threading
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from riot_bus.log.recorded_file import RecordedFile
from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.log.writing_queue import LostMessagesError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from riot_bus.log.account import LossCounts
    from riot_bus.log.engine.chunk import Row
    from riot_bus.record.naming import Naming
    from riot_bus.record.options import CaptureOptions
    from riot_bus.types.registry import TypeRegistry

FileT = TypeVar("FileT", bound=RecordedFile[LogWriter])


class RecordingSink:
    """Base of the destinations of a recording; thread-safe if `lock` is held where this is required.

    Args:
        metadata: Function that returns the metadata of each file.
        details: Function that returns more metadata of a key's channel.
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
        self._settings = LogSettings(
            compression=options.compression,
            chunk_bytes=options.chunk_bytes,
            chunk_seconds=options.chunk_seconds,
            threaded=True,
            durable=options.durable,
            queue_bytes=options.queue_bytes,
        )

    def append(self, rows: Sequence[Row], *, patient: bool) -> None:
        """Write messages, with the lock held; lost ones are counted."""
        self._file.attempt(partial(self.writer.append, rows, patient=patient))

    def renew(self, key: str) -> None:
        """Record further messages of a key with its type, which has become known."""
        with self.lock:
            self.writer.renew(key)
            self.generation += 1

    def _use(self, file: RecordedFile[LogWriter]) -> None:
        """Append to a file from now on."""
        self._file, self.writer, self.counts = file, file.writer, file.counts

    def _new_file(self, kind: type[FileT], path: Path | str, settings: LogSettings, **more: Any) -> FileT:
        writer = LogWriter(path, settings, registry=self._registry, channel_metadata=self._details, **more)
        return kind(writer, topic=self._registry.topic, lock=self.lock, failed=self._failed)

    def _failed(self, file: RecordedFile[LogWriter], error: Exception) -> None:
        """React to an error of a writer; the messages that it has lost are counted already."""
        if not isinstance(error, LostMessagesError):
            raise error
