"""Keeps the last seconds of a recording in memory, as compressed chunks, until they are requested as a file."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, Schema, Statistics

from riot_bus.log.engine.chunk import Chunk, Companions
from riot_bus.log.engine.mcap_file import McapFile, record_bytes, statistics_of
from riot_bus.log.engine.packing import PackedChunk, check_compression


class _Entry(NamedTuple):
    """A chunk and what belongs to it, or only a metadata record."""

    chunk: PackedChunk | None
    companions: Companions

    @property
    def weight(self) -> int:
        extras, note = self.companions
        texts = note[1].items() if note is not None else ()
        chunk = self.chunk.weight if self.chunk is not None else 0
        return chunk + len(extras) + sum(len(key) + len(text) for key, text in texts)


@dataclass(frozen=True, slots=True)
class RingContent:
    """What a ring held at one moment; times in nanoseconds, 0 if there is no message."""

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

        Raises ConfigError if the file cannot be created, OSError if the disk is full or has failed; then the file
        ends with the last whole chunk.
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
                if entry.chunk is not None:
                    file.packed(entry.chunk, entry.companions)
                elif entry.companions.note is not None:
                    file.metadata(*entry.companions.note)
            for name, mapping in after:
                file.metadata(name, mapping)
            file.finish(schemas, channels)
            file.sync()
            return file.size
        finally:
            file.close()


class Ring:
    """Keeps the chunks of a `LogWriter` in bounded memory, in place of a `McapFile`; thread-safe.

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
        return statistics_of(found.messages, found.start, found.end)

    def content(self) -> RingContent:
        """Return what is kept."""
        with self._lock:
            entries = list(self._entries)
        chunks = [each.chunk for each in entries if each.chunk is not None]
        messages: Counter[int] = Counter()
        for chunk in chunks:
            messages.update(chunk.counts)
        start = min((chunk.start for chunk in chunks), default=0)
        return RingContent(start, max((chunk.end for chunk in chunks), default=0), messages, entries)

    def is_linked(self) -> bool:
        """Return True: memory cannot be deleted like a file."""
        return True

    def sync(self) -> None:
        """Do nothing: memory does not outlive the process."""

    def chunk(self, chunk: Chunk, companions: Companions) -> None:
        """Keep a chunk with what belongs to it."""
        self._keep(_Entry(PackedChunk.of(chunk, self._compression), companions))

    def metadata(self, name: str, mapping: Mapping[str, str]) -> None:
        """Keep a metadata record."""
        self._keep(_Entry(None, Companions(note=(name, dict(mapping)))))

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
