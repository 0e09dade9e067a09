"""The last seconds of a recording, kept in memory as compressed chunks until they are wanted as a file."""

from __future__ import annotations

import threading
from collections import deque
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mcap.records import Statistics

from riot_bus.log.engine.mcap_file import McapFile, record_bytes
from riot_bus.log.engine.packing import PackedChunk, check_compression

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from mcap.records import Channel, Schema

    from riot_bus.log.engine.chunk import Chunk

__all__ = ["Ring", "RingContent"]


@dataclass(slots=True)
class _Entry:
    chunk: PackedChunk | None = None
    attachments: list[tuple[str, str, bytes]] = field(default_factory=list)
    notes: list[tuple[str, dict[str, str]]] = field(default_factory=list)

    @property
    def weight(self) -> int:
        return (
            (self.chunk.weight if self.chunk is not None else 0)
            + sum(len(data) for _, _, data in self.attachments)
            + sum(len(key) + len(text) for _, mapping in self.notes for key, text in mapping.items())
        )


@dataclass(frozen=True, slots=True)
class RingContent:
    """What a ring held at one moment.

    Attributes:
        start: Time of the earliest message, nanoseconds; 0 if there is none.
        end: Time of the latest message.
        messages: Number of messages by channel.
    """

    start: int
    end: int
    messages: Mapping[int, int]
    entries: Sequence[_Entry]

    def write(
        self,
        path: Path | str,
        *,
        profile: str,
        library: str,
        schemas: Sequence[Schema],
        channels: Sequence[Channel],
        notes: Sequence[tuple[str, Mapping[str, str]]] = (),
        after: Sequence[tuple[str, Mapping[str, str]]] = (),
    ) -> int:
        """Write all of it as a log; return its size in bytes.

        Args:
            path: File to create.
            profile: MCAP profile.
            library: Name of the writing library.
            schemas: Schemas from `LogWriter.definitions`; those that are not used here are left out.
            channels: Channels from `LogWriter.definitions`; those without messages here are left out.
            notes: Metadata records for the beginning.
            after: Metadata records for the end.

        Raises:
            ConfigError: The file cannot be created.
            OSError: The disk is full or has failed; the file ends with the last whole chunk.
        """
        channels = [each for each in channels if each.id in self.messages]
        wanted = {each.schema_id for each in channels}
        schemas = [each for each in schemas if each.id in wanted]
        file = McapFile(path, profile=profile, library=library, compression="none")
        try:
            for name, mapping in notes:
                file.metadata(name, mapping)
            file.define(b"".join(map(record_bytes, [*schemas, *channels])))
            for entry in self.entries:
                for name, media_type, data in entry.attachments:
                    file.attachment(name, media_type, data)
                for name, note in entry.notes:
                    file.metadata(name, note)
                if entry.chunk is not None:
                    file.packed(entry.chunk)
            for name, mapping in after:
                file.metadata(name, mapping)
            file.finish(schemas, channels)
            file.sync()
            return file.size
        finally:
            file.close()


class Ring:
    """Implements `riot_bus.log.writer.Storage` in bounded memory; thread-safe.

    Args:
        seconds: Least time span that is kept, by the times of messages, as long as there is room.
        most_bytes: Most bytes in memory, for compressed chunks.
        compression: `zstd`, `lz4` or `none`.

    Attributes:
        cut: Whether the messages discarded last had to go for lack of room, although they were not too old.
    """

    def __init__(self, seconds: float, *, most_bytes: int, compression: str = "zstd") -> None:
        check_compression(compression, "ring")
        self.cut = False
        self._ns, self._most, self._compression = int(seconds * 1e9), most_bytes, compression
        self._entries: deque[_Entry] = deque()
        self._open: _Entry | None = None
        self._size = 0
        self._lock = threading.Lock()

    @property
    def size(self) -> int:
        """Bytes in memory."""
        return self._size

    @property
    def statistics(self) -> Statistics:
        """Statistics of what is kept at present."""
        found = self.content()
        return Statistics(
            attachment_count=0,
            channel_count=len(found.messages),
            channel_message_counts=dict(found.messages),
            chunk_count=len(found.entries),
            message_count=sum(found.messages.values()),
            message_end_time=found.end,
            message_start_time=found.start,
            metadata_count=0,
            schema_count=0,
        )

    def content(self) -> RingContent:
        """Return what is kept."""
        with self._lock:
            entries = list(self._entries)
        chunks = [each.chunk for each in entries if each.chunk is not None]
        messages: dict[int, int] = {}
        for chunk in chunks:
            for channel, count in chunk.counts.items():
                messages[channel] = messages.get(channel, 0) + count
        start = min((chunk.start for chunk in chunks), default=0)
        return RingContent(start, max((chunk.end for chunk in chunks), default=0), messages, entries)

    def is_linked(self) -> bool:
        """Return True: memory cannot be deleted like a file."""
        return True

    def sync(self) -> None:
        """Do nothing: memory does not outlive the process."""

    @contextmanager
    def together(self) -> Iterator[None]:
        """Keep, and later discard, all that is appended within this block together."""
        self._open = _Entry()
        try:
            yield
        finally:
            entry, self._open = self._open, None
            if entry is not None:
                self._keep(entry)

    def define(self, records: bytes) -> None:
        """Do nothing: definitions are written when the content is."""

    def chunk(self, chunk: Chunk) -> None:
        """Keep a chunk."""
        packed = PackedChunk.of(chunk, self._compression)
        if self._open is not None:
            self._open.chunk = packed
        else:
            self._keep(_Entry(packed))

    def attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Keep an attachment."""
        each = (name, media_type, data)
        if self._open is not None:
            self._open.attachments.append(each)
        else:
            self._keep(_Entry(attachments=[each]))

    def metadata(self, name: str, mapping: Mapping[str, str]) -> None:
        """Keep a metadata record."""
        each = (name, dict(mapping))
        if self._open is not None:
            self._open.notes.append(each)
        else:
            self._keep(_Entry(notes=[each]))

    def finish(self, schemas: Sequence[Schema], channels: Sequence[Channel]) -> None:
        """Do nothing: what was not wanted as a file is discarded."""

    def close(self) -> None:
        """Do nothing; `content` still works."""

    def _keep(self, entry: _Entry) -> None:
        with self._lock:
            self._entries.append(entry)
            self._size += entry.weight
            newest = entry.chunk.end if entry.chunk is not None else 0
            while len(self._entries) > 1:
                first = self._entries[0].chunk
                old = newest and (first is None or first.end < newest - self._ns)
                if not old and self._size <= self._most:
                    break
                self.cut = not old
                self._size -= self._entries.popleft().weight
