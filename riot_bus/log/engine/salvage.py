"""Recovers the messages of a damaged chunk that its index confirms.

The checksum of a chunk shows that something is wrong, but not where. The index after the chunk has the position, the
channel and the time of each message. A message is taken if all of these agree, and if it ends where the next record
begins. Its payload may still be damaged.
"""

from __future__ import annotations

import os
import struct
from typing import TYPE_CHECKING, Any

import lz4.frame  # type: ignore[import-untyped]
from mcap.opcode import Opcode

from riot_bus.log.engine.blocks import (
    CHUNK,
    DEFINITIONS,
    HEAD,
    MESSAGE_HEAD,
    MOST_OTHERS,
    SHORTEST_MESSAGE,
    Block,
    Records,
    heads_of,
    unzstd,
    walk,
)
from riot_bus.log.engine.limits import DEFAULT_LIMITS, LogLimits

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

_INDEX = struct.Struct("<HI")
_PACKED_STEP = 1 << 10  # bytes of lz4 at once: up to this many are lost before a damaged place


def salvage(
    file: int, block: Block, limits: LogLimits = DEFAULT_LIMITS, *, memory: int | None = None
) -> Records | None:
    """Return the definitions and messages left of a chunk that cannot be read as a whole; None if nothing is left."""
    import numpy as np

    limit = limits.chunk if memory is None else min(limits.chunk, memory)
    if not block.chunked or block.cut or block.body.length > limit + CHUNK.size + 64:
        return None
    try:
        channels, times, offsets = _index(file, block, limits)
        data = _remains(os.pread(file, block.body.length, block.body.offset), limits, limit)
    except (OSError, ValueError, struct.error):
        return None
    if len(data) < MESSAGE_HEAD or not len(offsets):
        return None
    offsets = np.minimum(offsets, np.uint64(limit)).astype(np.int64)  # larger ones are invalid
    order = np.argsort(offsets, kind="stable")
    channels, times, offsets = channels[order], times[order], offsets[order]
    unique = np.concatenate([[True], offsets[1:] != offsets[:-1]])
    places = np.cumsum(unique) - 1
    following = np.append(offsets[unique], max(len(data), int(offsets[-1]) + 1))[places + 1]
    whole = offsets <= len(data) - MESSAGE_HEAD
    channels, times, begins, following, places = (each[whole] for each in (channels, times, offsets, following, places))
    heads = heads_of(data, begins)
    ends = begins + HEAD.size + np.minimum(heads["length"], np.uint64(len(data) + 1)).astype(np.int64)
    sound = (
        (heads["opcode"] == Opcode.MESSAGE)
        & (heads["length"] >= SHORTEST_MESSAGE)
        & (heads["channel"] == channels)
        & (heads["time"] == times)
        & (ends <= np.minimum(following, len(data)))
    )
    written = int(np.count_nonzero(unique))
    return _joined(data, begins[sound], ends[sound], following[sound], places[sound], written)


def _joined(
    data: bytes,
    begins: NDArray[Any],
    ends: NDArray[Any],
    following: NDArray[Any],
    places: NDArray[Any],
    written: int,
) -> Records | None:
    """Join the confirmed messages; between two messages there may only be whole records."""
    import numpy as np

    definitions, _ = _between(data, 0, int(begins[0])) if len(begins) else ([], False)
    kept = np.ones(len(begins), np.bool_)
    for row in np.flatnonzero(ends != following).tolist():
        found, whole = _between(data, int(ends[row]), int(following[row]))
        kept[row] = whole
        definitions += found if whole else []
        if len(definitions) > MOST_OTHERS:
            return None
    begins, ends, places = begins[kept], ends[kept], places[kept]
    if not len(begins):
        return None
    others, position = [], 0
    for begin, end in definitions:
        others.append((data[begin], position + HEAD.size, position + end - begin))
        position += end - begin
    lengths = ends - begins
    gaps = np.flatnonzero(begins[1:] != ends[:-1]) + 1
    runs = zip(begins[[0, *gaps]].tolist(), ends[[*(gaps - 1), -1]].tolist(), strict=True)
    pieces = [data[begin:end] for begin, end in [*definitions, *runs]]
    starts = np.cumsum(lengths) - lengths + position
    return Records(b"".join(pieces), starts, others, places, written - len(places))


def _between(data: bytes, position: int, end: int) -> tuple[list[tuple[int, int]], bool]:
    """Return start and end of each schema and channel, and whether there is nothing else."""
    found: list[tuple[int, int]] = []
    for opcode, begin, following in walk(data, position, end):
        if opcode not in DEFINITIONS or len(found) > MOST_OTHERS:
            break
        found.append((begin - HEAD.size, following))
        position = following
    return found, position == end


def _index(file: int, block: Block, limits: LogLimits) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return channel, time and offset of all messages, from the index records after a chunk."""
    import numpy as np

    channels: list[NDArray[Any]] = []
    entries: list[NDArray[Any]] = []
    count = 0
    position = sum(block.body)
    while True:
        head = os.pread(file, HEAD.size + _INDEX.size, position)
        if len(head) < HEAD.size + _INDEX.size:
            break
        opcode, length = HEAD.unpack_from(head)
        channel, size = _INDEX.unpack_from(head, HEAD.size)
        if opcode != Opcode.MESSAGE_INDEX or length != _INDEX.size + size or size % 16:
            break
        count += size // 16
        if count > limits.messages or len(channels) >= 1 << 16:
            raise ValueError("too many messages")
        rows = np.frombuffer(os.pread(file, size, position + len(head)), "<u8")
        if len(rows) != size // 8:
            break
        channels.append(np.full(len(rows) // 2, channel, np.uint16))
        entries.append(rows.reshape(-1, 2))
        position += HEAD.size + length
    if not entries:
        raise ValueError("no index")
    both = np.concatenate(entries)
    return np.concatenate(channels), both[:, 0], both[:, 1]


def _remains(body: bytes, limits: LogLimits, limit: int) -> bytes:
    """Return a chunk's records, decompressed as far as possible."""
    _, _, size, _, name_length = CHUNK.unpack_from(body)
    name = body[CHUNK.size : CHUNK.size + name_length]
    packed = body[CHUNK.size + name_length + 8 :]
    limits.check_size(size, len(packed))
    if size > limit:
        raise ValueError("too large")
    if name == b"":
        return packed[:size]
    if name not in (b"zstd", b"lz4"):
        raise ValueError("unknown compression")
    return b"".join(unzstd(packed, size, step=4 * _PACKED_STEP) if name == b"zstd" else _unlz4(packed, size))


def _unlz4(packed: bytes, size: int) -> Iterator[bytes]:
    frame = lz4.frame.LZ4FrameDecompressor()
    for begin in range(0, len(packed), _PACKED_STEP):
        try:
            piece = frame.decompress(packed[begin : begin + _PACKED_STEP], max_length=size)
        except (RuntimeError, EOFError):
            return
        size -= len(piece)
        if piece:
            yield piece
        if size <= 0 or frame.eof:
            return
