"""Reads a block of a log: its uncompressed bytes, and the positions of its records."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.opcode import Opcode

from riot_bus.log.engine.checksum import crc32
from riot_bus.log.engine.limits import DEFAULT_LIMITS, LogLimits

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import numpy as np
    from numpy.typing import NDArray

EXTRAS, EXTRAS_TYPE = "riot_bus.extras", "application/msgpack+zstd"
"""Name and media type of an attachment that belongs to the chunk after it; other attachments are left alone."""
TIMES = 1 << 64
"""MCAP's times have 64 bits and no sign: all lie below."""
NUMBERS = 1 << 16
"""MCAP's numbers of channels and schemas have 16 bits: all lie below."""
MAX_BLOCK = 1 << 30
"""Largest chunk in bytes, uncompressed, that is searched for after damage."""

MAGIC = bytes((137, 77, 67, 65, 80, 48, 13, 10))
"""First and last bytes of an MCAP file."""
HEAD = struct.Struct("<BQ")
"""Head of a record: opcode and length."""
CHUNK = struct.Struct("<QQQII")
MESSAGE = struct.Struct("<BQHIQQ")
"""Record of a message before its payload: opcode, length, channel, sequence, time, publish time."""
MESSAGE_HEAD = MESSAGE.size
"""Bytes of a message's record besides its payload."""
SHORTEST_MESSAGE = MESSAGE_HEAD - HEAD.size
"""Bytes of a message's record besides its payload, without opcode and length."""
DEFINITIONS = frozenset({Opcode.SCHEMA, Opcode.CHANNEL})
COMPRESSION_NAMES = ("", "lz4", "zstd")
"""Names of MCAP's compressions, as they stand in a chunk."""
MOST_OTHERS = 1 << 18
"""Most records of one block that are not messages: a damaged block must not exhaust the memory."""

_LENGTH = struct.Struct("<Q")
_REPEATED = 4  # after this many records of equal length in a row, more of them are searched for at once
_FIRST_LOOK = 32  # records; times 4 while all are equal: short runs cost little, long ones few calls


class Span(NamedTuple):
    """A range of bytes of the log file."""

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
    """The uncompressed records of a block, and their positions.

    Attributes:
        data: Bytes of the records.
        messages: Offset at which each message's record begins, shape (n,).
        others: Opcode, and start and end of the body, of each other record.
        numbers: Position of each message in the block as it was written, ascending, shape (n,), for what is left of a
            damaged block; None for 0, 1, 2 ...
        missing: Number of messages of a damaged block that are lost.
    """

    data: bytes
    messages: NDArray[Any]
    others: list[tuple[int, int, int]]
    numbers: NDArray[Any] | None = None
    missing: int = 0

    @property
    def most_written(self) -> int:
        """Upper bound of the number of messages in the block as it was written."""
        return len(self.data) // MESSAGE_HEAD if self.numbers is None else len(self.numbers) + self.missing

    def definitions(self) -> Iterator[tuple[int, bytes]]:
        """Yield opcode and body of each schema and channel."""
        for opcode, start, end in self.others:
            if opcode in DEFINITIONS:
                yield opcode, self.data[start:end]

    def renumbered(self, values: Mapping[int, Any]) -> Mapping[int, Any]:
        """Return values by index in `messages`, given those by position in the block as it was written."""
        if self.numbers is None:
            return values
        return {index: values[number] for index, number in enumerate(self.numbers.tolist()) if number in values}


@cache
def head_type() -> np.dtype[Any]:
    """Return the numpy type of a message's record before its payload; numpy is only imported when it is needed."""
    import numpy as np

    names = ("opcode", "length", "channel", "sequence", "time", "published")
    return np.dtype(list(zip(names, ("u1", "<u8", "<u2", "<u4", "<u8", "<u8"), strict=True)))


def heads_of(data: bytes | bytearray, places: NDArray[np.int64]) -> NDArray[Any]:
    """Return the heads of the messages at these offsets, which need not be aligned, as an array of `head_type`."""
    import numpy as np

    # In place where messages are equally long, otherwise by gathering whole heads: a loop would take 100 times as long.
    raw, steps = f"V{MESSAGE_HEAD}", np.diff(places)
    stride = int(steps[0]) if len(steps) and (steps == steps[0]).all() else 0
    if stride > 0:
        heads = np.ndarray((len(places),), raw, data, int(places[0]), (stride,)).copy()
    elif len(places):
        heads = np.ndarray((len(data) - MESSAGE_HEAD + 1,), raw, data, 0, (1,))[places]
    else:
        heads = np.empty(0, raw)
    return heads.view(head_type())


def walk(data: bytes, position: int = 0, end: int | None = None) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, and start and end of the body, of each whole record from a position on.

    This is for few records: `records_of` and `load_block` have loops of their own, which cost a third per message.
    """
    end = len(data) if end is None else min(end, len(data))
    while position + HEAD.size <= end:
        opcode, length = HEAD.unpack_from(data, position)
        begin, position = position + HEAD.size, position + HEAD.size + length
        if position > end:
            return
        yield opcode, begin, position


def message_bytes(channel: int, sequence: int, time: int, published: int, payload: bytes) -> bytes:
    """Return the record of a message; numbers have to fit 16, 32, 64 and 64 bits."""
    return MESSAGE.pack(Opcode.MESSAGE, SHORTEST_MESSAGE + len(payload), channel, sequence, time, published) + payload


def read_block(file: int, block: Block, limits: LogLimits = DEFAULT_LIMITS, *, memory: int | None = None) -> bytes:
    """Return a block's records, uncompressed; for a chunk that was cut off, what is left.

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


def claimed_size(file: int, block: Block) -> int:
    """Return how many bytes a block claims to have once it is decompressed, 0 if it cannot be read."""
    if not block.chunked:
        return block.body.length
    try:
        return int(CHUNK.unpack(os.pread(file, CHUNK.size, block.body.offset))[2])
    except (OSError, struct.error):
        return 0


def read_packed(file: int, block: Block, most: int | None = None) -> tuple[str, bytes] | None:
    """Return the compression of a chunk, `none` included, and its compressed records; None if that is unknown."""
    body = os.pread(file, block.body.length if most is None else min(most, block.body.length), block.body.offset)
    try:
        name, packed = _split_chunk(body)
    except (struct.error, UnicodeDecodeError):
        return None
    return (name or "none", packed) if name in COMPRESSION_NAMES else None


def _split_chunk(body: bytes) -> tuple[str, bytes]:
    """Return the name of a chunk's compression and its compressed records; raises struct.error, UnicodeDecodeError."""
    *_, name_length = CHUNK.unpack_from(body)
    begin = CHUNK.size + name_length
    (length,) = _LENGTH.unpack_from(body, begin)
    return body[CHUNK.size : begin].decode(), body[begin + _LENGTH.size :][:length]


def records_of(data: bytes, limits: LogLimits = DEFAULT_LIMITS, *, cut: bool) -> Records:
    """Return the records of a block and their positions.

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
                raise ValueError(f"more than {MOST_OTHERS} records that are not messages")
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
    return Records(data, messages, others)


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
        _, _, size, checksum, _ = CHUNK.unpack_from(body)
        compression, packed = _split_chunk(body)
    except (struct.error, UnicodeDecodeError) as error:
        if block.cut:
            return b""
        raise ValueError("the header of a chunk is damaged") from error
    limits.check_size(size, len(packed))
    if memory is not None and size > memory:
        raise ValueError(f"a chunk of {size} bytes is larger than the memory for it, {memory}")
    try:
        data = _decompress(packed, compression, size, cut=block.cut)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        if block.cut:
            return b""
        raise ValueError(f"{compression} data: {error}") from error
    if not block.cut and (len(data) != size or (checksum and crc32(data) != checksum)):
        raise ValueError("the data of a chunk do not have the size or the checksum that its header states")
    return data


def _decompress(packed: bytes, compression: str, size: int, *, cut: bool) -> bytes:
    """Decompress data, but never to more than the size that it claims."""
    if compression == "":
        return packed
    if compression == "zstd":
        if zstandard.frame_content_size(packed) > size and not cut:
            raise ValueError("the zstd data of a chunk are larger than its header states")
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
