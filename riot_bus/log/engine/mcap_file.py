"""Writes an MCAP file: whole records only, and a summary at the end."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from riot_bus.log.engine.blocks import EXTRAS, EXTRAS_TYPE, MAGIC
from riot_bus.log.engine.checksum import crc32
from riot_bus.log.engine.chunk import Chunk, Companions
from riot_bus.log.engine.packing import PackedChunk, check_compression
from riot_bus.vocabulary.errors import ConfigError

_CHUNK = struct.Struct("<BQQQQII")
_FOOTER = struct.Struct("<BQQQ")
_NONE = Companions()


def record_bytes(record: McapRecord) -> bytes:
    """Return a record as it stands in a file."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class McapFile:
    """Appends records to a file; after an error it ends with the last whole record, and the next one is tried again.

    It is an error if the disk is full or fails (OSError), or, at the beginning, if the file cannot be created
    (ConfigError). The statistics are those of MCAP, of what was written so far.
    """

    def __init__(self, path: Path | str, *, profile: str, library: str, compression: str) -> None:
        check_compression(compression, str(path))
        self._compression = compression
        self.statistics = statistics_of({}, 0, 0)
        kinds = (Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX)
        self._indexes: dict[Opcode, list[McapRecord]] = {opcode: [] for opcode in kinds}
        self._missing = b""  # definitions of a chunk that could not be written
        self._end = 0
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise ConfigError(f"cannot write the log: {error.strerror}", where=str(path)) from error
        try:
            self._append(MAGIC, record_bytes(Header(profile=profile, library=library)))
        except OSError as error:
            self.close()
            raise ConfigError(f"cannot write the log: {error.strerror}", where=str(path)) from error

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._end

    def is_linked(self) -> bool:
        """Return whether the file still has a name; not all file systems can tell."""
        return os.fstat(self._file).st_nlink > 0

    def sync(self) -> None:
        """Wait until everything written is on the disk; raises OSError."""
        os.fdatasync(self._file)

    def define(self, records: bytes) -> None:
        """Write schema and channel records before the next chunk, which does not contain them."""
        self._missing += records

    def chunk(self, chunk: Chunk, companions: Companions = _NONE) -> None:
        """Append a chunk with what belongs to it; raises OSError, and then nothing of it is in the file."""
        try:
            self.packed(PackedChunk.of(chunk, self._compression), companions)
        except Exception:
            self._missing += chunk.definitions
            raise

    def packed(self, chunk: PackedChunk, companions: Companions = _NONE) -> None:
        """Append a chunk that is packed already, as `chunk` does."""
        end, counts = self._end, {opcode: len(records) for opcode, records in self._indexes.items()}
        try:
            if companions.extras:
                self.attachment(Attachment(0, 0, EXTRAS, EXTRAS_TYPE, companions.extras))
            if companions.note is not None:
                self.metadata(*companions.note)
            self._append_chunk(chunk)
        except Exception:
            self._end = end
            with suppress(OSError):  # what is there is overwritten, or read as cut off
                os.ftruncate(self._file, end)
            for opcode, count in counts.items():
                del self._indexes[opcode][count:]
            raise

    def _append_chunk(self, chunk: PackedChunk) -> None:
        compression = "" if chunk.compression == "none" else chunk.compression
        name = compression.encode()
        packed = chunk.length
        start, length = self._end + len(self._missing), 40 + len(name) + packed
        head = _CHUNK.pack(Opcode.CHUNK, length, chunk.start, chunk.end, chunk.size, chunk.checksum, len(name))
        offsets, position = {}, start + 9 + length
        for channel, record in chunk.indexes.items():
            offsets[channel] = position
            position += len(record)
        body = (head, name, struct.pack("<Q", packed), *chunk.data)
        self._append(self._missing, *body, *chunk.indexes.values())
        self._missing = b""
        self._indexes[Opcode.CHUNK_INDEX].append(
            ChunkIndex(
                chunk_length=9 + length,
                chunk_start_offset=start,
                compression=compression,
                compressed_size=packed,
                message_end_time=chunk.end,
                message_index_length=position - start - 9 - length,
                message_index_offsets=offsets,
                message_start_time=chunk.start,
                uncompressed_size=chunk.size,
            )
        )
        self._count(chunk)

    def attachment(self, attachment: Attachment) -> None:
        """Append an attachment; raises OSError."""
        record = record_bytes(attachment)
        index = AttachmentIndex(
            offset=self._end,
            length=len(record),
            log_time=attachment.log_time,
            create_time=attachment.create_time,
            data_size=len(attachment.data),
            name=attachment.name,
            media_type=attachment.media_type,
        )
        self._append(record)
        self._indexes[Opcode.ATTACHMENT_INDEX].append(index)

    def metadata(self, name: str, mapping: Mapping[str, str]) -> None:
        """Append a metadata record; raises OSError."""
        record = record_bytes(Metadata(name=name, metadata=dict(mapping)))
        index = MetadataIndex(offset=self._end, length=len(record), name=name)
        self._append(record)
        self._indexes[Opcode.METADATA_INDEX].append(index)

    def finish(self, schemas: Sequence[Schema], channels: Sequence[Channel]) -> None:
        """Append summary and footer; raises OSError."""
        known, indexes = self.statistics, self._indexes
        known.schema_count, known.channel_count = len(schemas), len(channels)
        known.attachment_count = len(indexes[Opcode.ATTACHMENT_INDEX])
        known.metadata_count = len(indexes[Opcode.METADATA_INDEX])
        known.chunk_count = len(indexes[Opcode.CHUNK_INDEX])
        self._append(self._missing, record_bytes(DataEnd(data_section_crc=0)))
        self._missing = b""
        groups: list[tuple[Opcode, Sequence[McapRecord]]] = [
            (Opcode.SCHEMA, schemas),
            (Opcode.CHANNEL, channels),
            (Opcode.STATISTICS, [known]),
            *indexes.items(),
        ]
        start = self._end
        summary, offsets = b"", b""
        for opcode, records in groups:
            data = b"".join(map(record_bytes, records))
            if data:
                offset = SummaryOffset(group_opcode=opcode, group_start=start + len(summary), group_length=len(data))
                offsets += record_bytes(offset)
            summary += data
        offset_start = start + len(summary)
        summary += offsets
        checksum = crc32(_FOOTER.pack(Opcode.FOOTER, 20, start, offset_start), crc32(summary))
        footer = Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=checksum)
        self._append(summary, record_bytes(footer), MAGIC)

    def close(self) -> None:
        """Close the file as it is; safe to call twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _append(self, *parts: bytes) -> None:
        position = self._end
        unwritten = [part for part in parts if part]
        try:
            while unwritten:
                written = os.pwritev(self._file, unwritten[:1000], position)  # it takes 1024
                position += written
                unwritten = _without(unwritten, written)
        except OSError:
            with suppress(OSError):  # whatever is there of this record is read as cut off
                os.ftruncate(self._file, self._end)
            raise
        self._end = position

    def _count(self, chunk: PackedChunk) -> None:
        known = self.statistics
        if not chunk.counts:
            return
        first = not known.message_count
        known.message_start_time = chunk.start if first else min(known.message_start_time, chunk.start)
        known.message_end_time = max(known.message_end_time, chunk.end)
        for channel, count in chunk.counts.items():
            known.channel_message_counts[channel] = known.channel_message_counts.get(channel, 0) + count
            known.message_count += count


def statistics_of(counts: Mapping[int, int], start: int, end: int) -> Statistics:
    """Return statistics of messages: their number by channel, and the times of the first and last, nanoseconds."""
    return Statistics(
        attachment_count=0,
        channel_count=len(counts),
        channel_message_counts=dict(counts),
        chunk_count=0,
        message_count=sum(counts.values()),
        message_end_time=end,
        message_start_time=start,
        metadata_count=0,
        schema_count=0,
    )


def _without(parts: list[bytes], written: int) -> list[bytes]:
    """Return the rest of the parts after this many written bytes."""
    for place, part in enumerate(parts):
        if written < len(part):
            return [part[written:], *parts[place + 1 :]]
        written -= len(part)
    return []
