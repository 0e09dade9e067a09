"""The content of a block of a log: its uncompressed bytes, and the positions of its records."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.opcode import Opcode

from riot_bus.log.engine.checksum import crc32
from riot_bus.log.engine.limits import DEFAULT_LIMITS, LogLimits

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

__all__ = ["EXTRAS", "MAX_BLOCK", "Block", "Records", "Span", "packed_size", "read_block", "records_of", "unzstd"]

EXTRAS = "riot_bus.extras"
"""Name of an attachment that belongs to the chunk after it; other attachments are left alone."""
MAX_BLOCK = 1 << 30
"""Largest chunk in bytes, uncompressed, that is searched for after damage."""

HEAD = struct.Struct("<BQ")
CHUNK = struct.Struct("<QQQII")
SHORTEST_MESSAGE = 22
"""Bytes of a message's record besides its payload, without opcode and length."""
MOST_OTHERS = 1 << 18
"""Most records of one block that are not messages: a damaged block must not exhaust the memory."""

_REPEATED = 4  # after this many records of equal length in a row, more of them are searched for at once
_FIRST_LOOK = 32  # records; times 4 while all are equal: short runs cost little, long ones few calls


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


@dataclass(slots=True)
class Records:
    """The positions of the records of a block.

    Attributes:
        messages: Offset at which each message's record begins, shape (n,).
        others: Opcode, and start and end of the body, of each other record.
    """

    messages: NDArray[Any]
    others: list[tuple[int, int, int]] = field(default_factory=list)


def read_block(file: int, block: Block, limits: LogLimits = DEFAULT_LIMITS, *, memory: int | None = None) -> bytes:
    """Return a block's records, uncompressed; for a chunk that was cut off, what is left.

    Args:
        file: Descriptor of the log.
        block: The block that is read.
        limits: Limits of what is read.
        memory: Most bytes, before and after decompression, if these are fewer.

    Raises:
        ValueError: The block is damaged, larger than that, or, as BeyondLimitError, beyond the limits.
    """
    length = block.body.length if not block.cut else min(block.body.length, limits.chunk)
    if length > CHUNK.size + 64:
        limits.check_size(length - CHUNK.size - 64, length)
    if memory is not None and length > memory + CHUNK.size + 64:
        raise ValueError(f"a block of {length} bytes")
    try:
        data = os.pread(file, length, block.body.offset)
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from error
    return _unpack_chunk(data, block, limits, memory) if block.chunked else data


def packed_size(head: bytes) -> int:
    """Return the uncompressed size that the head of a chunk claims."""
    return int(CHUNK.unpack_from(head)[2])


def records_of(data: bytes, limits: LogLimits = DEFAULT_LIMITS, *, cut: bool) -> Records:
    """Find the records in a block.

    Args:
        data: Result of `read_block`.
        limits: Limits of what is read.
        cut: Whether the last record may be incomplete.

    Raises:
        ValueError: A record goes beyond the end, or there are too many.
    """
    import numpy as np

    parts: list[NDArray[Any]] = []
    single: list[int] = []
    others: list[tuple[int, int, int]] = []
    position, size = 0, len(data)
    unpack, head_size, is_message = HEAD.unpack_from, HEAD.size, int(Opcode.MESSAGE)
    former, repeated, patience = -1, 0, _REPEATED
    while position + head_size <= size:
        opcode, length = unpack(data, position)
        following = position + head_size + length
        if following > size or not opcode:
            break
        if opcode != is_message:
            others.append((opcode, position + head_size, following))
            if len(others) > MOST_OTHERS:
                raise ValueError(f"more than {MOST_OTHERS} records that are no messages")
            position = following
            continue
        if length < SHORTEST_MESSAGE:
            break
        single.append(position)
        position = following
        if length != former:
            former, repeated = length, 0
            limits.check_messages(len(single))
            continue
        repeated += 1
        if repeated >= patience:
            count = _equal_run(data, position, length)
            patience = _REPEATED if count >= _REPEATED else min(2 * patience, 1 << 10)
            repeated = 0
            if count:
                stride = head_size + length
                parts += [np.array(single, np.int64), position + stride * np.arange(count, dtype=np.int64)]
                single = []
                position += stride * count
    if position != size and not cut:
        raise ValueError("a record inside goes beyond its end")
    parts.append(np.array(single, np.int64))
    messages = np.concatenate(parts)
    limits.check_messages(len(messages))
    return Records(messages, others)


def _equal_run(data: bytes, position: int, length: int) -> int:
    """Return how many messages of this length follow one another from this position on."""
    import numpy as np

    stride = HEAD.size + length
    found, look = 0, _FIRST_LOOK
    while True:
        count = min(look, (len(data) - position) // stride)
        if not count:
            return found
        opcodes = np.ndarray((count,), np.uint8, data, position, (stride,))
        lengths = np.ndarray((count,), "<u8", data, position + 1, (stride,))
        equal = (opcodes == Opcode.MESSAGE) & (lengths == length)
        if not equal.all():
            return found + int(equal.argmin())
        found += count
        if count < look:
            return found
        position += count * stride
        look *= 4


def _unpack_chunk(body: bytes, block: Block, limits: LogLimits, memory: int | None) -> bytes:
    try:
        _, _, size, checksum, name_length = CHUNK.unpack_from(body)
        compression = body[CHUNK.size : CHUNK.size + name_length].decode()
        (length,) = struct.unpack_from("<Q", body, CHUNK.size + name_length)
    except (struct.error, UnicodeDecodeError) as error:
        if block.cut:
            return b""
        raise ValueError("chunk header") from error
    begin = CHUNK.size + name_length + 8
    packed = body[begin : begin + length]
    limits.check_size(size, len(packed))
    if memory is not None and size > memory:
        raise ValueError(f"a chunk of {size} bytes")
    try:
        data = _decompress(packed, compression, size, cut=block.cut)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        if block.cut:
            return b""
        raise ValueError(f"{compression} data: {error}") from error
    if not block.cut and (len(data) != size or (checksum and crc32(data) != checksum)):
        raise ValueError("checksum")
    return data


def _decompress(packed: bytes, compression: str, size: int, *, cut: bool) -> bytes:
    """Decompress data, but never to more than the size that it claims."""
    if compression == "":
        return packed
    if compression == "zstd":
        if zstandard.frame_content_size(packed) > size and not cut:
            raise ValueError("zstd frame size")
        if cut:
            return b"".join(unzstd(packed, size, step=1 << 17))
        return zstandard.decompress(packed, max_output_size=size) if size else b""
    if compression == "lz4":
        unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
        return unpacked
    raise ValueError(f"unknown compression {compression!r}")


def unzstd(packed: bytes, size: int, *, step: int) -> Iterator[bytes]:
    """Yield what is left of damaged zstd data, at most `size` bytes, in pieces of at most `step` bytes."""
    reader = zstandard.ZstdDecompressor().stream_reader(packed)
    while size > 0:
        try:
            piece = reader.read(min(size, step))
        except zstandard.ZstdError:
            return
        if not piece:
            return
        size -= len(piece)
        yield piece
