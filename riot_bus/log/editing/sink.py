"""Destinations of edited messages: files by time, size or topic, or nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from riot_bus.log.editing.output_file import OutputFile
from riot_bus.log.editing.result import WrittenFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from riot_bus.log.editing.batch import Batch
    from riot_bus.log.editing.options import EditOptions
    from riot_bus.log.editing.output_file import ReadyChunk
    from riot_bus.log.editing.outputs import Outputs
    from riot_bus.log.editing.targets import OutputChannel

__all__ = ["FileSink", "NullSink", "Sink"]


class Sink(Protocol):
    """A destination of messages."""

    def write(
        self, batch: Batch, targets: Sequence[OutputChannel | None], ready: Callable[[], ReadyChunk | None] | None
    ) -> None:
        """Write messages.

        Args:
            batch: Messages to write.
            targets: Channels of the output, by number of the course.
            ready: Function that returns the chunk that holds exactly these messages, if there is one.
        """
        ...


class NullSink:
    """A destination that ignores all messages."""

    def write(
        self, batch: Batch, targets: Sequence[OutputChannel | None], ready: Callable[[], ReadyChunk | None] | None
    ) -> None:
        """Do nothing."""


class FileSink:
    """Writes messages to files.

    Args:
        options: Options of the edit, which tell how files are split.
        outputs: Object that gives the files their names.
        profile: MCAP profile.
        compression: Compression of their chunks.
        began: Function that is called with each file when it is opened.
    """

    def __init__(
        self,
        options: EditOptions,
        outputs: Outputs,
        *,
        profile: str,
        compression: str,
        began: Callable[[OutputFile], None],
    ) -> None:
        self._options = options
        self._outputs = outputs
        self._profile = profile
        self._compression = compression
        self._began = began
        self._current: dict[str, OutputFile] = {}
        self._numbers: dict[str, int] = {}
        self._begins: dict[str, int] = {}
        self.parts: list[tuple[OutputFile, Path, str]] = []

    def write(
        self, batch: Batch, targets: Sequence[OutputChannel | None], ready: Callable[[], ReadyChunk | None] | None
    ) -> None:
        """Write messages to the files that they belong to."""
        whole = len(batch)
        for label, share in self._shares(batch, targets):
            while len(share):
                part = self._part(label, int(share.time[0]))
                count = self._fitting(label, share)
                piece = share if count == len(share) else share.take(slice(0, count))
                found = ready() if ready is not None and count == whole else None
                if found is None or not part.copy(piece, targets, found):
                    part.write(piece, targets)
                share = share.take(slice(count, None))

    def part_for(self, target: OutputChannel | None) -> OutputFile:
        """Return a file for a channel that may have no messages, or for nothing at all."""
        label = target.name if self._options.split_topics and target is not None else ""
        return self._current.get(label) or self._open(label)

    def files(self) -> list[WrittenFile]:
        """Return the files that were written."""
        return [WrittenFile(final, path.stat().st_size, part.messages) for part, path, final in self.parts]

    def close(self) -> None:
        """Close all files as they are; safe to call twice."""
        for part, _, _ in self.parts:
            part.close()

    def _shares(self, batch: Batch, targets: Sequence[OutputChannel | None]) -> Iterator[tuple[str, Batch]]:
        if not self._options.split_topics:
            yield "", batch
            return
        names = {number: targets[number].name for number in np.unique(batch.course).tolist()}
        for name in dict.fromkeys(names.values()):
            numbers = [number for number, each in names.items() if each == name]
            yield name, batch.where(np.isin(batch.course, numbers))

    def _part(self, label: str, time: int) -> OutputFile:
        part, options = self._current.get(label), self._options
        if part is not None:
            self._begins.setdefault(label, time)
            late = options.split_seconds is not None and time >= self._begins[label] + options.split_seconds * 1e9
            large = options.split_bytes is not None and part.messages and part.size() >= options.split_bytes
            if not late and not large:
                return part
            part.drain()  # this file gets no more messages, only records about the whole edit
        span = int((options.split_seconds or 0.0) * 1e9)
        former = self._begins.get(label)
        self._begins[label] = time if former is None or not span else former + (time - former) // span * span
        return self._open(label)

    def _fitting(self, label: str, share: Batch) -> int:
        """Return how many messages go into the current file before it may have to be changed."""
        count = len(share)
        if self._options.split_seconds is not None:
            end = self._begins[label] + self._options.split_seconds * 1e9
            later = np.flatnonzero(share.time >= np.uint64(min(int(end), (1 << 64) - 1)))
            count = int(later[0]) if len(later) else count
        if self._options.split_bytes is not None:
            room = self._options.split_bytes - self._current[label].size()
            sizes = np.cumsum(share.end - share.start)
            count = min(count, int(np.searchsorted(sizes, max(room, 1), side="left")) + 1)
        return max(count, 1)

    def _open(self, label: str) -> OutputFile:
        options = self._options
        number = self._numbers[label] = self._numbers.get(label, -1) + 1
        names = [label] if options.split_topics else []
        if options.split_seconds is not None or options.split_bytes is not None:
            names.append(str(number))
        path, final = self._outputs.path("_".join(names) if names else None)
        part = OutputFile(
            path, final, profile=self._profile, compression=self._compression, chunk_bytes=options.chunk_bytes
        )
        self.parts.append((part, path, final))
        self._current[label] = part
        self._began(part)
        return part
