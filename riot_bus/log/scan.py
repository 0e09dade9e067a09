"""Find and load the parts of an MCAP file, whoever wrote it and however it ends.

The file is walked once from record to record, skipping the data of chunks, so damage or a missing summary costs nothing
but the damaged part, and memory holds one entry per chunk.
"""

from __future__ import annotations

import os
import struct
import zlib
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, NamedTuple, TypeVar

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema, Statistics

from riot_bus.errors import ConfigError
from riot_bus.log import layout

__all__ = ["Block", "Entry", "Scan", "load_block", "parse", "scan_file"]

MAGIC = bytes((137, 77, 67, 65, 80, 48, 13, 10))
RecordT = TypeVar("RecordT")

_HEAD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")
_MESSAGE = struct.Struct("<BQHIQQ")
_PLAIN_BLOCK = 1 << 20


class Span(NamedTuple):
    """A part of the file."""

    offset: int
    length: int


@dataclass(slots=True)
class Block:
    """A chunk, or a run of messages outside any chunk."""

    number: int
    body: Span
    start: int
    end: int
    chunked: bool
    cut: bool = False
    extras: Span | None = None


class Entry(NamedTuple):
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
    header: Header | None = None
    blocks: list[Block] = field(default_factory=list)
    metadata: list[tuple[str, Span]] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    statistics: Statistics | None = None
    finished: bool = False
    unread: int = 0
    """Bytes at the end of which nothing can be said."""


def scan_file(file: int, path: str) -> Scan:
    """Walk over a file.

    Raises:
        ConfigError: It is not an MCAP file.
    """
    size = os.fstat(file).st_size
    if os.pread(file, len(MAGIC), 0) != MAGIC:
        if size == 0:
            raise ConfigError("the file is empty", where=path, hint="was the recorder stopped before it began?")
        hint = "logs are .mcap files; rosbags-convert makes one of a .bag or .db3"
        raise ConfigError("not an MCAP file", where=path, hint=hint)
    scan = Scan(size)
    position, extras = len(MAGIC), None
    while position < size and not scan.finished:
        head = os.pread(file, 128, position)
        opcode, length = _HEAD.unpack_from(head) if len(head) >= _HEAD.size else (0, 0)
        body = Span(position + _HEAD.size, length)
        cut = opcode == 0 or body.offset + length > size
        if cut:
            scan.unread = size - position
        inside = head[_HEAD.size :]
        if opcode == Opcode.CHUNK and len(inside) >= _CHUNK.size:
            start, end = _CHUNK.unpack_from(inside)[:2]
            span = Span(body.offset, min(length, size - body.offset))
            scan.blocks.append(Block(len(scan.blocks), span, start, end, chunked=True, cut=cut, extras=extras))
            extras = None
        if cut:
            return scan
        match opcode:
            case Opcode.MESSAGE if len(inside) >= 22:
                (time,) = struct.unpack_from("<Q", inside, 6)
                _add_plain(scan, position, _HEAD.size + length, time)
            case Opcode.ATTACHMENT:
                extras = _extras_span(body, inside) or extras
            case Opcode.METADATA:
                scan.metadata.append((_text(inside, 0)[0], body))
            case Opcode.HEADER:
                scan.header = parse(Header, os.pread(file, min(length, 1 << 16), body.offset))
            case Opcode.SCHEMA | Opcode.CHANNEL | Opcode.STATISTICS if length <= layout.MAX_BLOCK:
                define(scan, opcode, os.pread(file, length, body.offset))
            case Opcode.FOOTER:
                scan.finished = True
        position = body.offset + length
    return scan


def define(scan: Scan, opcode: int, body: bytes) -> None:
    """Take in a schema, channel or statistics record; a damaged one is left out."""
    if opcode == Opcode.SCHEMA:
        schema = parse(Schema, body)
        if schema is not None:
            scan.schemas.setdefault(schema.id, schema)
    elif opcode == Opcode.CHANNEL:
        channel = parse(Channel, body)
        if channel is not None:
            scan.channels.setdefault(channel.id, channel)
    else:
        scan.statistics = parse(Statistics, body)


def parse(kind: type[RecordT], body: bytes) -> RecordT | None:
    """Decode the body of a record, None if it is damaged."""
    try:
        record: RecordT = kind.read(ReadDataStream(BytesIO(body)))  # type: ignore[attr-defined]
    except (McapError, struct.error, ValueError):
        return None
    return record


def read_metadata(file: int, span: Span) -> dict[str, str] | None:
    """Load a metadata record, None if it is damaged."""
    record = parse(Metadata, os.pread(file, min(span.length, layout.MAX_BLOCK), span.offset))
    return None if record is None else record.metadata


def load_extras(file: int, block: Block) -> dict[int, dict[str, Any]]:
    """Load a block's extras by place in the block; raises ValueError on damage."""
    if block.extras is None:
        return {}
    body = os.pread(file, min(block.extras.length, layout.MAX_BLOCK), block.extras.offset)
    if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
        raise ValueError("checksum of extras")
    _, position = _text(body, 16)
    _, position = _text(body, position)
    return layout.unpack_extras(body[position + 8 : -4])


def load_block(file: int, block: Block, scan: Scan, extras: dict[int, dict[str, Any]]) -> list[Entry]:
    """Load a block's messages in file order, and take in its schemas and channels.

    Raises:
        ValueError: The block is damaged; of a block that was cut off, what is left is returned instead.
    """
    data = os.pread(file, min(block.body.length, layout.MAX_BLOCK), block.body.offset)
    if block.chunked:
        data = _unpack_chunk(data, block)
    entries: list[Entry] = []
    order, place = block.number << 32, 0
    position, size = 0, len(data)
    unpack, head_size, is_message = _MESSAGE.unpack_from, _MESSAGE.size, int(Opcode.MESSAGE)
    while position + _HEAD.size <= size:
        if data[position] == is_message and position + head_size <= size:
            _, length, channel, sequence, time, published = unpack(data, position)
            following = position + 9 + length
            if following > size or length < 22:
                break
            payload = data[position + head_size : following]
            entries.append(Entry(time, order + place, channel, sequence, published, payload, extras.get(place)))
            place += 1
        else:
            opcode, length = _HEAD.unpack_from(data, position)
            following = position + 9 + length
            if following > size or opcode == is_message:
                break
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                define(scan, opcode, data[position + 9 : following])
        position = following
    if position != size and not block.cut:
        raise ValueError("a record inside goes beyond its end")
    return entries


def _unpack_chunk(body: bytes, block: Block) -> bytes:
    try:
        _, _, size, checksum, name_length = _CHUNK.unpack_from(body)
        compression = body[_CHUNK.size : _CHUNK.size + name_length].decode()
        (length,) = struct.unpack_from("<Q", body, _CHUNK.size + name_length)
    except (struct.error, UnicodeDecodeError) as error:
        if block.cut:
            return b""
        raise ValueError("chunk header") from error
    begin = _CHUNK.size + name_length + 8
    packed = body[begin : begin + length]
    if size > layout.MAX_BLOCK:
        raise ValueError(f"a chunk of {size} bytes")
    try:
        data = _decompress(packed, compression, size, cut=block.cut)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        if block.cut:
            return b""
        raise ValueError(f"{compression} data: {error}") from error
    if not block.cut and (len(data) != size or (checksum and zlib.crc32(data) != checksum)):
        raise ValueError("checksum")
    return data


def _decompress(packed: bytes, compression: str, size: int, *, cut: bool) -> bytes:
    if compression == "":
        return packed
    if compression == "zstd":
        if zstandard.frame_content_size(packed) > layout.MAX_BLOCK:
            raise ValueError("zstd frame size")
        if cut:
            return zstandard.ZstdDecompressor().decompressobj().decompress(packed)[:size]
        return zstandard.decompress(packed, max_output_size=size)
    if compression == "lz4":
        unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
        return unpacked
    raise ValueError(f"unknown compression {compression!r}")


def _add_plain(scan: Scan, position: int, length: int, time: int) -> None:
    last = scan.blocks[-1] if scan.blocks else None
    joins = last and not last.chunked and sum(last.body) == position
    if last and joins and last.body.length < _PLAIN_BLOCK:
        last.body = Span(last.body.offset, last.body.length + length)
        last.start, last.end = min(last.start, time), max(last.end, time)
    else:
        scan.blocks.append(Block(len(scan.blocks), Span(position, length), time, time, chunked=False))


def _extras_span(body: Span, inside: bytes) -> Span | None:
    return body if _text(inside, 16)[0] == layout.EXTRAS else None


def _text(data: bytes, position: int) -> tuple[str, int]:
    length = int.from_bytes(data[position : position + 4], "little")
    begin = position + 4
    return data[begin : begin + length].decode("utf-8", "replace"), begin + length
