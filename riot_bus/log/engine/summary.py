"""The summary at the end of an MCAP file: what can be said of a log without reading it, if the summary is sound."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Header, MetadataIndex, Schema, Statistics

from riot_bus.log.engine.blocks import HEAD, Span
from riot_bus.log.engine.checksum import crc32
from riot_bus.log.engine.scan import FOOTER_BYTES, MAGIC, parse, parse_footer

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["Summary", "read_summary"]

_LARGEST = 1 << 28
_DATA_END = HEAD.size + 4
_OPCODES = frozenset(
    {
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.STATISTICS,
        Opcode.CHUNK_INDEX,
        Opcode.ATTACHMENT_INDEX,
        Opcode.METADATA_INDEX,
        Opcode.SUMMARY_OFFSET,
    }
)


@dataclass(slots=True)
class Summary:
    """What the summary says."""

    size: int
    header: Header
    statistics: Statistics
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[tuple[str, Span]] = field(default_factory=list)

    def spans(self) -> dict[int, tuple[int, int]]:
        """Return about from when to when the messages of each channel go: as the chunks say that have some."""
        known = self.statistics
        if not self.chunks or not any(chunk.message_index_offsets for chunk in self.chunks):
            return dict.fromkeys(self.channels, (known.message_start_time, known.message_end_time))
        found: dict[int, tuple[int, int]] = {}
        for chunk in self.chunks:
            start, end = chunk.message_start_time, chunk.message_end_time
            for channel in chunk.message_index_offsets:
                low, high = found.get(channel, (start, end))
                found[channel] = min(low, start), max(high, end)
        return found


def read_summary(file: int) -> Summary | None:
    """Return the summary of a file; None if it has none, or one that disagrees with itself or with the file."""
    try:
        return _read(file)
    except OSError:
        return None


def _read(file: int) -> Summary | None:
    size = os.fstat(file).st_size
    head = os.pread(file, len(MAGIC) + HEAD.size + (1 << 16), 0)
    tail = os.pread(file, FOOTER_BYTES, size - FOOTER_BYTES) if size > len(head[:8]) + FOOTER_BYTES else b""
    footer = parse_footer(tail)
    if footer is None or head[: len(MAGIC)] != MAGIC or len(head) < len(MAGIC) + HEAD.size:
        return None
    start, end = footer.summary_start, size - FOOTER_BYTES
    opcode, length = HEAD.unpack_from(head, len(MAGIC))
    begin = len(MAGIC) + HEAD.size
    header = parse(Header, head[begin : begin + length]) if opcode == Opcode.HEADER else None
    if header is None or not begin + length + _DATA_END <= start < end or end - start > _LARGEST:
        return None
    if HEAD.unpack(os.pread(file, HEAD.size, start - _DATA_END)) != (Opcode.DATA_END, 4):
        return None
    data = os.pread(file, end - start, start)
    signed = crc32(tail[: HEAD.size + 16], crc32(data))
    if footer.summary_crc and footer.summary_crc != signed:
        return None
    found = _parse(data, size, header)
    return found if found is not None and _is_sound(file, found, start) else None


def _parse(data: bytes, size: int, header: Header) -> Summary | None:
    statistics: Statistics | None = None
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    chunks: list[ChunkIndex] = []
    metadata: list[tuple[str, Span]] = []
    for opcode, body in _records(data):
        if opcode not in _OPCODES:
            return None
        if opcode == Opcode.SCHEMA and (schema := parse(Schema, body)) is not None:
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL and (channel := parse(Channel, body)) is not None:
            channels[channel.id] = channel
        elif opcode == Opcode.STATISTICS:
            statistics = parse(Statistics, body)
        elif opcode == Opcode.CHUNK_INDEX and (chunk := parse(ChunkIndex, body)) is not None:
            chunks.append(chunk)
        elif opcode == Opcode.METADATA_INDEX and (index := parse(MetadataIndex, body)) is not None:
            metadata.append((index.name, Span(index.offset + HEAD.size, max(0, index.length - HEAD.size))))
    if statistics is None:
        return None
    return Summary(size, header, statistics, schemas, channels, chunks, metadata)


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    position = 0
    while position + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, position)
        following = position + HEAD.size + length
        if following > len(data):
            break
        yield opcode, data[position + HEAD.size : following]
        position = following
    if position != len(data):
        yield 0, b""


def _is_sound(file: int, summary: Summary, end: int) -> bool:
    known = summary.statistics
    counts = known.channel_message_counts
    agree = (
        known.channel_count == len(summary.channels)
        and known.chunk_count == len(summary.chunks)
        and known.metadata_count == len(summary.metadata)
        and known.message_count == sum(counts.values())
        and summary.channels.keys() >= counts.keys()
        and all(each.schema_id == 0 or each.schema_id in summary.schemas for each in summary.channels.values())
    )
    if not agree:
        return False
    position = len(MAGIC)
    for chunk in sorted(summary.chunks, key=lambda each: each.chunk_start_offset):
        if chunk.chunk_start_offset < position:
            return False
        position = chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length
    return position <= end and all(_is_there(file, chunk) for chunk in (summary.chunks[:1] + summary.chunks[-1:]))


def _is_there(file: int, chunk: ChunkIndex) -> bool:
    head = os.pread(file, HEAD.size, chunk.chunk_start_offset)
    return len(head) == HEAD.size and HEAD.unpack(head) == (Opcode.CHUNK, chunk.chunk_length - HEAD.size)
