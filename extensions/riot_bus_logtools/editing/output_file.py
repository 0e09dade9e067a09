"""Writes one file of the output of an edit; a separate thread compresses and writes chunks."""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.log import layout
from riot_bus.log.engine.blocks import MESSAGE_HEAD, heads_of
from riot_bus.log.engine.checksum import crc32
from riot_bus.log.engine.chunk import LARGE, Chunk, chunk_of, indexes_of
from riot_bus.log.engine.mcap_file import McapFile
from riot_bus.log.engine.packing import PackedChunk, worthwhile
from riot_bus.log.layout import Provenance
from riot_bus.log.writing_queue import MOST_PENDING
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus_logtools.editing.batch import runs_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Future
    from pathlib import Path

    from mcap.records import Attachment
    from numpy.typing import NDArray

    from riot_bus.log.engine.chunk import Companions
    from riot_bus_logtools.editing.batch import Batch
    from riot_bus_logtools.editing.channel_edit import OutputChannel


@dataclass(slots=True)
class _Draft:
    """The parts of a future chunk; joining them takes time, so it is done on the writing thread.

    Attributes:
        rows: Channel, time and length of the messages of each batch, shape (n,) each.
        extras: Positions of messages, and their extras.
        size: Bytes of the messages and their attachments.
    """

    definitions: list[bytes] = field(default_factory=list)
    pieces: list[memoryview | bytes] = field(default_factory=list)
    rows: list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]] = field(default_factory=list)
    extras: list[tuple[int, dict[str, Any]]] = field(default_factory=list)
    provenance: list[Provenance] = field(default_factory=list)
    count: int = 0
    size: int = 0

    def companions(self) -> Companions:
        """Return extras and provenance as they stand before the chunk."""
        return layout.companions(self.extras, self.provenance)

    def chunk(self) -> Chunk:
        """Return the chunk: definitions, then messages, and an index of them."""
        data = b"".join(self.pieces)
        channels, times, lengths = (np.concatenate(parts) for parts in zip(*self.rows, strict=True))
        large = _large(data, np.cumsum(lengths) - lengths, lengths)
        return chunk_of(b"".join(self.definitions), (data,), channels, times, lengths, large)


class OutputFile:
    """Writes messages to one file; raises ConfigError if it cannot be written."""

    def __init__(self, path: Path, where: str, *, profile: str, compression: str, chunk_bytes: int) -> None:
        self.path = path
        self.compression = compression
        self._where = where
        self._chunk_bytes = chunk_bytes
        self._file = McapFile(path, profile=profile, library=layout.LIBRARY, compression=compression)
        self._targets: dict[int, OutputChannel] = {}
        self._draft = _Draft()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="riot-edit")
        self._pending: deque[Future[None]] = deque()
        self.messages = 0

    def size(self) -> int:
        """Return the size of the file with all messages written so far, the last chunk counted uncompressed."""
        self._collect(0)
        return self._file.size + self._draft.size

    @property
    def span(self) -> tuple[int, int]:
        """Times of the earliest and the latest message, nanoseconds; known after `finish`."""
        known = self._file.statistics
        return known.message_start_time, known.message_end_time

    def targets(self) -> tuple[list[OutputChannel], Mapping[int, int]]:
        """Return its channels by number, and how many messages each has, known after `drain`."""
        targets = [each for _, each in sorted(self._targets.items())]
        return targets, self._file.statistics.channel_message_counts

    def write(self, batch: Batch, targets: Sequence[OutputChannel | None]) -> None:
        """Write messages whose records have the channel numbers of the output; raises EnvironmentFaultError.

        The targets are the channels of the output, by number of the channel edit.
        """
        for number in np.unique(batch.edit).tolist():
            self.define(targets[number])
        sizes = np.cumsum(batch.end - batch.start)
        position, count = 0, len(batch)
        while position < count:
            done = int(sizes[position - 1]) if position else 0
            room = max(1, self._chunk_bytes - self._draft.size)
            following = min(count, int(np.searchsorted(sizes, done + room, side="left")) + 1)
            self._append(batch.take(slice(position, following)), targets)
            if self._draft.size >= self._chunk_bytes:
                self._end_chunk()
            position = following

    def copy(self, batch: Batch, targets: Sequence[OutputChannel | None], ready: tuple[str, bytes]) -> bool:
        """Write a whole chunk unchanged, if all its messages are the batch's; return whether that was done."""
        if 0 < self._draft.size < self._chunk_bytes // 8:
            return False  # else what waits would become a small chunk
        compression, data = ready
        if compression != self.compression:
            large = _large(batch.buffer, batch.start, batch.end - batch.start)
            if compression != worthwhile(self.compression, large, len(batch.buffer)):
                return False
        self._end_chunk()
        for number in np.unique(batch.edit).tolist():
            self.define(targets[number])
        heads = heads_of(batch.buffer, batch.start)
        packed = PackedChunk(
            compression,
            (data,),
            len(batch.buffer),
            crc32(batch.buffer),
            int(batch.time.min()),
            int(batch.time.max()),
            *indexes_of(heads["channel"], batch.time, batch.start),
        )
        self._take_extras(batch, targets, heads)
        draft, self._draft = self._draft, _Draft()
        self.messages += len(batch)
        self._submit(self._store_packed, draft, packed)
        return True

    def attachment(self, attachment: Attachment) -> None:
        """Write an attachment of another tool; raises EnvironmentFaultError."""
        self._submit(self._file.attachment, attachment)

    def metadata(self, name: str, mapping: dict[str, str]) -> None:
        """Write a metadata record; raises EnvironmentFaultError."""
        self._submit(self._file.metadata, name, mapping)

    def drain(self) -> None:
        """Wait until all messages are in the file; raises EnvironmentFaultError."""
        self._end_chunk()
        self._collect(0)

    def finish(self) -> None:
        """Write the summary and make sure that all is on the disk; raises EnvironmentFaultError."""
        self.drain()
        targets, _ = self.targets()
        schemas = {each.schema.id: each.schema for each in targets if each.schema is not None}
        ordered = [schemas[number] for number in sorted(schemas)]
        if self._draft.definitions:  # those of channels without messages
            self._file.define(b"".join(self._draft.definitions))
        self._submit(self._file.finish, ordered, [each.channel for each in targets])
        self._submit(self._file.sync)
        self._collect(0)

    def close(self) -> None:
        """Close the file as it is; safe to call twice."""
        self._thread.shutdown(cancel_futures=True)
        self._file.close()

    def define(self, target: OutputChannel | None) -> None:
        """Define a channel, even if it gets no messages."""
        assert target is not None
        number = target.channel.id
        if number not in self._targets:
            self._targets[number] = target
            self._draft.definitions.append(target.definition())

    def _append(self, batch: Batch, targets: Sequence[OutputChannel | None]) -> None:
        view = memoryview(batch.buffer)
        self._draft.pieces += [view[begin:end] for begin, end in runs_of(batch)]
        heads = heads_of(batch.buffer, batch.start)
        self._draft.rows.append((heads["channel"], batch.time, batch.end - batch.start))
        self._take_extras(batch, targets, heads)
        self._draft.count += len(batch)
        self._draft.size += batch.weight
        self.messages += len(batch)

    def _take_extras(self, batch: Batch, targets: Sequence[OutputChannel | None], heads: NDArray[Any]) -> None:
        if batch.extras is not None:
            for row, extras in enumerate(batch.extras.tolist()):
                if extras is not None:
                    self._draft.extras.append((self._draft.count + row, extras))
                    attachment = extras.get("a")
                    self._draft.size += len(attachment) if isinstance(attachment, bytes) else 0
        if batch.notes is not None:
            for row, changes in enumerate(batch.notes.tolist()):
                if changes is not None:
                    target = targets[int(batch.edit[row])]
                    assert target is not None
                    number = batch.extras[row].get("n") if batch.extras is not None and batch.extras[row] else None
                    sequence = number if isinstance(number, int) else int(heads["sequence"][row])
                    note = Provenance(sequence, target.source.key, int(batch.time[row]), target.source.role, changes)
                    self._draft.provenance.append(note)

    def _end_chunk(self) -> None:
        if self._draft.count:
            draft, self._draft = self._draft, _Draft()
            self._submit(self._store, draft)

    def _store(self, draft: _Draft) -> None:
        self._file.chunk(draft.chunk(), draft.companions())

    def _store_packed(self, draft: _Draft, chunk: PackedChunk) -> None:
        self._file.define(b"".join(draft.definitions))
        self._file.packed(chunk, draft.companions())

    def _submit(self, action: Any, *arguments: Any) -> None:
        self._pending.append(self._thread.submit(action, *arguments))
        self._collect(MOST_PENDING)

    def _collect(self, most: int) -> None:
        while len(self._pending) > most:
            try:
                self._pending.popleft().result()
            except OSError as error:
                hint = "make room; nothing was changed"
                text = f"the log cannot be written: {error.strerror or error}"
                raise EnvironmentFaultError(text, where=self._where, hint=hint) from error


def _large(data: bytes | bytearray, offsets: NDArray[Any], lengths: NDArray[Any]) -> tuple[memoryview, ...]:
    """Return the large payloads among messages that begin at these offsets."""
    view, least = memoryview(data), LARGE + MESSAGE_HEAD
    large = zip(offsets[lengths >= least].tolist(), lengths[lengths >= least].tolist(), strict=True)
    return tuple(view[begin + MESSAGE_HEAD : begin + length] for begin, length in large)
