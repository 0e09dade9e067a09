"""Reads the summary at the end of an MCAP file: an overview of a log without reading it, if the summary is sound."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import Channel, Header, MetadataIndex, Schema, Statistics

from riot_bus.log.engine.blocks import HEAD, MAGIC, Span, walk
from riot_bus.log.engine.checksum import crc32
from riot_bus.log.engine.limits import DEFAULT_LIMITS, LogLimits
from riot_bus.log.engine.scan import FOOTER_BYTES, parse, parse_footer

_DATA_END = HEAD.size + 4
_INDEX = struct.Struct("<QQQQI")
_OFFSET = struct.Struct("<HQ")
_DEFINING = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS})
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
class ChunkIndexes:
    """The combined content of all chunk indexes, which are not kept, because they may be many.

    Attributes:
        most: Most indexes that are accepted.
        count: Number of chunks.
        spans: Earliest and latest time of the chunks that have messages of a channel, by channel.
        ends: Offset and length of the first and the last chunk.
        end: Offset at which the last one ends, with its message index.
    """

    most: int
    count: int = 0
    spans: dict[int, tuple[int, int]] = field(default_factory=dict)
    ends: tuple[Span, Span] | None = None
    end: int = len(MAGIC)

    def add(self, body: bytes) -> bool:
        """Add an index; return whether it is whole, after the previous chunk, and not one too many."""
        if len(body) < _INDEX.size:
            return False
        start, end, offset, length, size = _INDEX.unpack_from(body)
        middle = _INDEX.size + size
        if size % _OFFSET.size or middle + 8 > len(body) or offset < self.end or self.count >= self.most:
            return False
        for channel, _ in _OFFSET.iter_unpack(body[_INDEX.size : middle]):
            low, high = self.spans.get(channel, (start, end))
            self.spans[channel] = min(low, start), max(high, end)
        place = Span(offset, length)
        self.ends = place if self.ends is None else self.ends[0], place
        self.count += 1
        self.end = offset + length + int.from_bytes(body[middle : middle + 8], "little")
        return True


@dataclass(slots=True)
class Summary:
    """The header of a log, and what its summary section says.

    Attributes:
        metadata: Name of each metadata record, with the place of its body in the file.
    """

    size: int
    header: Header
    statistics: Statistics
    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    chunks: ChunkIndexes
    metadata: list[tuple[str, Span]]

    def spans(self) -> dict[int, tuple[int, int]]:
        """Return the approximate time span of the messages of each channel, from the chunks that have some."""
        known = self.statistics
        return self.chunks.spans or dict.fromkeys(self.channels, (known.message_start_time, known.message_end_time))


def read_summary(file: int, limits: LogLimits = DEFAULT_LIMITS) -> Summary | None:
    """Return the summary of a file; None if it has none, or one that disagrees with itself or with the file."""
    try:
        return _read(file, limits)
    except OSError:
        return None


def _read(file: int, limits: LogLimits) -> Summary | None:
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
    if header is None or not begin + length + _DATA_END <= start < end or end - start > limits.held:
        return None
    if HEAD.unpack(os.pread(file, HEAD.size, start - _DATA_END)) != (Opcode.DATA_END, 4):
        return None
    data = os.pread(file, end - start, start)
    signed = crc32(tail[: HEAD.size + 16], crc32(data))
    if footer.summary_crc and footer.summary_crc != signed:
        return None
    found = _parse(data, size, header, limits)
    return found if found is not None and _is_sound(file, found, start) else None


def _parse(data: bytes, size: int, header: Header, limits: LogLimits) -> Summary | None:
    statistics: Statistics | None = None
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    metadata: list[tuple[str, Span]] = []
    most, defined = limits.chunks_of(size), 0
    chunks = ChunkIndexes(most)
    position = 0
    for opcode, begin, position in walk(data):
        body = data[begin:position]
        defined += len(body) if opcode in _DEFINING else 0
        if opcode not in _OPCODES or defined > limits.definitions or len(metadata) > most:
            return None
        if opcode == Opcode.CHUNK_INDEX and not chunks.add(body):
            return None
        if opcode == Opcode.SCHEMA and (schema := parse(Schema, body)) is not None:
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL and (channel := parse(Channel, body)) is not None:
            channels[channel.id] = channel
        elif opcode == Opcode.STATISTICS:
            statistics = parse(Statistics, body)
        elif opcode == Opcode.METADATA_INDEX and (index := parse(MetadataIndex, body)) is not None:
            metadata.append((index.name, Span(index.offset + HEAD.size, max(0, index.length - HEAD.size))))
    if statistics is None or position != len(data):
        return None
    return Summary(size, header, statistics, schemas, channels, chunks, metadata)


def _is_sound(file: int, summary: Summary, end: int) -> bool:
    known = summary.statistics
    counts = known.channel_message_counts
    agree = (
        known.channel_count == len(summary.channels)
        and known.chunk_count == summary.chunks.count
        and known.metadata_count == len(summary.metadata)
        and known.message_count == sum(counts.values())
        and summary.channels.keys() >= counts.keys()
        and all(each.schema_id == 0 or each.schema_id in summary.schemas for each in summary.channels.values())
    )
    return agree and summary.chunks.end <= end and all(_is_there(file, chunk) for chunk in summary.chunks.ends or ())


def _is_there(file: int, chunk: Span) -> bool:
    head = os.pread(file, HEAD.size, chunk.offset)
    return len(head) == HEAD.size and HEAD.unpack(head) == (Opcode.CHUNK, chunk.length - HEAD.size)
