"""Finds and loads the parts of an MCAP file from any writer, however it ends.

The file is walked once from record to record, skipping the data of chunks, so damage or a missing summary costs nothing
but the damaged part, and memory holds one entry per chunk. After a record whose length is damaged, the walk continues
at the next chunk.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, NamedTuple, TypeVar

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Header, Metadata, Schema, Statistics

from riot_bus.log.engine.blocks import (
    CHUNK,
    DEFINITIONS,
    EXTRAS,
    HEAD,
    MAGIC,
    MESSAGE,
    MOST_OTHERS,
    SHORTEST_MESSAGE,
    Block,
    Span,
)
from riot_bus.log.engine.checksum import crc32
from riot_bus.log.engine.limits import DEFAULT_LIMITS, BeyondLimitError, LogLimits
from riot_bus.vocabulary.errors import ConfigError

FOOTER_BYTES = HEAD.size + 20 + len(MAGIC)
"""Bytes at the end of a file that was closed: footer and magic."""

RecordT = TypeVar("RecordT")

_SHORTEST_CHUNK = CHUNK.size + 8


class MessageEntry(NamedTuple):
    """One message as it is in the file; sorts by time, then by place in the file."""

    time: int
    order: int
    channel: int
    sequence: int
    published: int
    payload: bytes
    extras: dict[str, Any] | None


@dataclass(slots=True)
class Scan:
    """What a file holds."""

    size: int
    limits: LogLimits = DEFAULT_LIMITS
    header: Header | None = None
    blocks: list[Block] = field(default_factory=list)
    metadata: list[tuple[str, Span]] = field(default_factory=list)
    attachments: list[Span] = field(default_factory=list)  # other than the extras of a chunk
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    statistics: Statistics | None = None
    finished: bool = False
    unread: int = 0  # bytes that cannot be interpreted: at the end, or after a damaged length
    damaged: set[int] = field(default_factory=set)  # checksums of definitions; 0 for too many other records
    conflicts: set[int] = field(default_factory=set)  # channels defined in different ways; the first one counts
    defined: int = 0  # bytes of definitions that were accepted
    refused: BeyondLimitError | None = None  # the first limit because of which something is left out or `damaged`
    stopped: bool = False  # whether the file has more chunks than its limits allow
    unpacked: int = 0  # bytes that its chunks and their extras take, uncompressed, also those of dropped chunks
    dropped: int = 0  # chunks that are left out because all of them together take too much
    joins: bool = False  # whether a message outside of chunks belongs to the last block: only definitions are between

    def refuse(self, problem: str, limit: str, present: int, needed: int) -> None:
        """Note that something is left out because of a limit, unless another limit was noted before."""
        self.refused = self.refused or BeyondLimitError(problem, limit, present, needed)

    def add_packed(self, size: int, packed: int) -> None:
        """Note that something takes this many bytes, uncompressed, unless it will be refused anyway."""
        with suppress(ValueError):
            self.limits.check_size(size, packed)
            self.unpacked += max(0, size)

    @property
    def missing_chunks(self) -> int:
        """Number of chunks that the summary counts, but that are missing."""
        known = self.statistics.chunk_count if self.statistics is not None and self.finished else 0
        return max(0, known - sum(block.chunked for block in self.blocks))


def scan_file(file: int, path: str, limits: LogLimits = DEFAULT_LIMITS) -> Scan:
    """Walk over a file; raises ConfigError if it is not an MCAP file."""
    size = os.fstat(file).st_size
    try:
        if os.pread(file, len(MAGIC), 0) != MAGIC:
            if size == 0:
                raise ConfigError("the file is empty", where=path, hint="was the recorder stopped before it began?")
            hint = "logs are .mcap files; rosbags-convert makes one of a .bag or .db3"
            raise ConfigError("not an MCAP file", where=path, hint=hint)
        return _walk(file, Scan(size, limits))
    except OSError as error:
        raise ConfigError(f"cannot read the log: {error.strerror}", where=path) from error


def _walk(file: int, scan: Scan) -> Scan:
    size, position, gaps = scan.size, len(MAGIC), 0
    most, room = scan.limits.chunks_of(size), max(scan.limits.total, scan.limits.ratio * size)
    extras: Span | None = None
    while position < size and not scan.finished:
        head = os.pread(file, 128, position)
        opcode, length = HEAD.unpack_from(head) if len(head) >= HEAD.size else (0, 0)
        body = Span(position + HEAD.size, length)
        following = body.offset + length
        cut = opcode == 0 or following > size
        if cut:
            gaps += 1
            # A search reads 64 KiB or more: many in a hostile file would take hours.
            following = _after_gap(file, scan, position) if gaps <= 1000 else size
            scan.unread += following - position
        inside = head[HEAD.size :]
        if opcode == Opcode.CHUNK and len(inside) >= CHUNK.size and length >= _SHORTEST_CHUNK:
            start, end, unpacked = CHUNK.unpack_from(inside)[:3]
            span = Span(body.offset, max(0, following - body.offset))
            scan.add_packed(unpacked, length)
            if scan.unpacked <= room:
                scan.blocks.append(Block(len(scan.blocks), span, start, end, chunked=True, cut=cut, extras=extras))
            else:
                scan.dropped += 1
            extras = None
        if not cut:
            extras = _process(file, scan, opcode, position, body, inside) or extras
        if opcode != Opcode.MESSAGE or length < SHORTEST_MESSAGE or cut:
            scan.joins = scan.joins and not cut and (opcode in DEFINITIONS or opcode > Opcode.DATA_END)
        if len(scan.blocks) > most:
            scan.blocks.pop()
            following = _stop(file, scan, position)
        position = following
    if scan.dropped:
        scan.refuse(f"{scan.unpacked} bytes in all chunks of {size}", "total", room, scan.unpacked)
    return scan


def _stop(file: int, scan: Scan, position: int) -> int:
    """Note that there are too many chunks; return where to continue: at the summary, but only once."""
    most, footer = scan.limits.chunks_of(scan.size), _footer(file, scan)
    scan.refuse(f"more than {most} chunks", "chunks", scan.limits.chunks, 4 * most)
    again, scan.stopped = scan.stopped, True
    if again or footer is None:
        return scan.size
    scan.finished = not footer.summary_start
    return footer.summary_start if footer.summary_start > position else scan.size


def _process(file: int, scan: Scan, opcode: int, position: int, body: Span, inside: bytes) -> Span | None:
    """Process a record; return its span if it holds extras."""
    length = body.length
    match opcode:
        case Opcode.MESSAGE if length >= SHORTEST_MESSAGE:
            (time,) = struct.unpack_from("<Q", inside, 6)
            _add_plain(scan, position, HEAD.size + length, time)
        case Opcode.ATTACHMENT if (unpacked := _extras_size(inside)) is not None:
            scan.add_packed(unpacked, length)
            return body
        case Opcode.ATTACHMENT:
            if _has_place(scan, scan.attachments):
                scan.attachments.append(body)
        case Opcode.METADATA:
            if _has_place(scan, scan.metadata):
                scan.metadata.append((_text(inside, 0)[0], body))
        case Opcode.HEADER:
            scan.header = scan.header or parse(Header, os.pread(file, min(length, 1 << 16), body.offset))
        case Opcode.SCHEMA | Opcode.CHANNEL | Opcode.STATISTICS:
            if length <= scan.limits.definitions:
                define(scan, opcode, os.pread(file, length, body.offset))
            else:
                _refuse(scan, length, position)
        case Opcode.FOOTER:
            scan.finished = True
    return None


def _extras_size(inside: bytes) -> int | None:
    """Return how many bytes extras take, uncompressed, negative if they do not say; None for other attachments."""
    name, position = _text(inside, 16)
    begin = _text(inside, position)[1] + 8
    if name != EXTRAS or begin + 18 > len(inside):  # at most so many bytes has a frame's header (RFC 8878, 3.1.1.1)
        return None
    with suppress(zstandard.ZstdError):
        return zstandard.frame_content_size(inside[begin:])
    return -1  # they are damaged, which counts when they are read


def _after_gap(file: int, scan: Scan, position: int) -> int:
    """Return where to continue after an invalid record: at a chunk, at the summary, or at the end of the file."""
    from riot_bus.log.engine.resync import next_record

    found = next_record(file, position + 1, scan.size, scan.channels)
    if found is None:
        footer = _footer(file, scan)
        found = footer.summary_start if footer is not None and footer.summary_start else scan.size
        if not position < found <= scan.size - FOOTER_BYTES:
            found = scan.size
    return found


def _footer(file: int, scan: Scan) -> Footer | None:
    tail = os.pread(file, FOOTER_BYTES, scan.size - FOOTER_BYTES) if scan.size > FOOTER_BYTES else b""
    return parse_footer(tail)


def parse_footer(tail: bytes) -> Footer | None:
    """Return the footer from the last bytes of a file, None if it has none."""
    if len(tail) != FOOTER_BYTES or tail[-len(MAGIC) :] != MAGIC or HEAD.unpack_from(tail) != (Opcode.FOOTER, 20):
        return None
    return parse(Footer, tail[HEAD.size : -len(MAGIC)])


def define(scan: Scan, opcode: int, body: bytes) -> None:
    """Add a schema, channel or statistics record; a damaged one is left out and counted."""
    if len(body) > scan.limits.definitions:
        _refuse(scan, len(body), crc32(body))
        return
    kinds: dict[int, type[Schema | Channel | Statistics]] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}
    record = parse(kinds.get(opcode, Statistics), body)
    if record is None:
        scan.damaged.add(crc32(body))
    elif isinstance(record, Statistics):
        scan.statistics = record
    elif isinstance(record, Schema):
        if record.id not in scan.schemas and _has_room(scan, body):
            scan.schemas[record.id] = record
    else:
        known = scan.channels.get(record.id)
        if known is not None and known != record:
            scan.conflicts.add(record.id)
        elif known is None and _has_room(scan, body):
            scan.channels[record.id] = record


def _has_room(scan: Scan, body: bytes) -> bool:
    if scan.defined + len(body) > scan.limits.definitions:
        _refuse(scan, scan.defined + len(body), crc32(body))
        return False
    scan.defined += len(body)
    return True


def _refuse(scan: Scan, needed: int, mark: int) -> None:
    """Note a definition that is too large; the mark identifies it."""
    scan.damaged.add(mark)
    scan.refuse(f"{needed} bytes of definitions", "definitions", scan.limits.definitions, needed)


def _has_place(scan: Scan, among: Sequence[object]) -> bool:
    """Return whether another metadata record, or another attachment, is accepted."""
    most = scan.limits.chunks_of(scan.size)
    if len(among) < most:
        return True
    scan.damaged.add(0)
    scan.refuse(f"more than {most} such records", "chunks", most, 4 * most)
    return False


def parse(kind: type[RecordT], body: bytes) -> RecordT | None:
    """Decode the body of a record, None if it is damaged."""
    try:
        record: RecordT = kind.read(ReadDataStream(BytesIO(body)))  # type: ignore[attr-defined]
    except (McapError, struct.error, ValueError):
        return None
    return record


def read_metadata(file: int, span: Span, limits: LogLimits = DEFAULT_LIMITS) -> dict[str, str] | None:
    """Load a metadata record, None if it is damaged, or beyond the limits."""
    if span.length > limits.definitions:
        return None
    record = parse(Metadata, os.pread(file, span.length, span.offset))
    return None if record is None else record.metadata


def read_attachment(file: int, span: Span, limits: LogLimits = DEFAULT_LIMITS) -> bytes:
    """Return the data of an attachment; raises ValueError if it is damaged or, as BeyondLimitError, too large."""
    limits.check_size(span.length, span.length)
    body = os.pread(file, span.length, span.offset)
    if crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
        raise ValueError("checksum of an attachment")
    _, position = _text(body, 16)
    _, position = _text(body, position)
    return body[position + 8 : -4]


def load_block(data: bytes, block: Block, scan: Scan, extras: Mapping[int, dict[str, Any]]) -> list[MessageEntry]:
    """Return a block's messages in file order, and add its schemas and channels to the scan.

    Raises ValueError if the block is damaged; for one that was cut off, what is left is returned instead.
    """
    entries: list[MessageEntry] = []
    order, place, others, most = block.number << 32, 0, 0, scan.limits.messages
    position, size = 0, len(data)
    unpack, head_size, is_message = MESSAGE.unpack_from, MESSAGE.size, int(Opcode.MESSAGE)
    while position + HEAD.size <= size:
        if data[position] == is_message and position + head_size <= size:
            _, length, channel, sequence, time, published = unpack(data, position)
            following = position + 9 + length
            if following > size or length < SHORTEST_MESSAGE:
                break
            payload = data[position + head_size : following]
            entries.append(MessageEntry(time, order + place, channel, sequence, published, payload, extras.get(place)))
            place += 1
            if place > most:
                scan.limits.check_messages(place)
        else:
            opcode, length = HEAD.unpack_from(data, position)
            following = position + 9 + length
            others += 1
            if following > size or opcode in (0, is_message):
                break
            if others > MOST_OTHERS:
                raise ValueError(f"more than {MOST_OTHERS} records that are not messages")
            if opcode in DEFINITIONS:
                define(scan, opcode, data[position + 9 : following])
        position = following
    if position != size and not block.cut:
        raise ValueError("a record inside goes beyond its end")
    return entries


def _add_plain(scan: Scan, position: int, length: int, time: int) -> None:
    last = scan.blocks[-1] if scan.blocks else None
    # 1 MiB, as a usual chunk: smaller blocks need more entries, larger ones load longer.
    if last and scan.joins and position < last.body.offset + (1 << 20):
        last.body = Span(last.body.offset, position + length - last.body.offset)
        last.start, last.end = min(last.start, time), max(last.end, time)
    else:
        scan.blocks.append(Block(len(scan.blocks), Span(position, length), time, time, chunked=False))
        scan.joins = True


def _text(data: bytes, position: int) -> tuple[str, int]:
    length = int.from_bytes(data[position : position + 4], "little")
    begin = position + 4
    return data[begin : begin + length].decode("utf-8", "replace"), begin + length
