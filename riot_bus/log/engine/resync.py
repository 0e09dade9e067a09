"""Searches for the next record of an MCAP file after a damaged one, where the walk over the file can continue."""

from __future__ import annotations

import os
import struct
from collections.abc import Container

from mcap.opcode import Opcode

from riot_bus.log.engine.blocks import CHUNK, HEAD, MAX_BLOCK, SHORTEST_MESSAGE

_FIRST_WINDOW, _WINDOW = 1 << 16, 1 << 22  # most damage is short; the search takes several times a window in memory
_NAMES = (b"", b"lz4", b"zstd")
_CHUNK_HEAD = HEAD.size + CHUNK.size + len(b"zstd") + 8
_NAME_LENGTH = HEAD.size + CHUNK.size - 4


def next_record(file: int, start: int, size: int, channels: Container[int]) -> int | None:
    """Return where the next chunk, or run of messages outside chunks, begins; None if there is none.

    Chunks are recognised by the lengths in their head, which must agree. Messages must be of known channels and be
    followed by other whole records.
    """
    import numpy as np

    position, window = start, _FIRST_WINDOW
    while True:
        data = os.pread(file, window + _CHUNK_HEAD, position)
        if len(data) < _CHUNK_HEAD:
            return None
        count = min(window, len(data) - _CHUNK_HEAD + 1)
        raw = np.frombuffer(data, np.uint8)
        small = (raw[6 : 6 + count] | raw[7 : 7 + count] | raw[8 : 8 + count]) == 0  # less than 2^40 bytes
        possible = small & ((raw[:count] == Opcode.CHUNK) | (raw[:count] == Opcode.MESSAGE))
        for at in np.flatnonzero(possible).tolist():
            if data[at] == Opcode.CHUNK:
                if _is_chunk(data, at, position + at, size):
                    return int(position + at)
                continue
            length, channel = struct.unpack_from("<QH", data, at + 1)
            if length >= SHORTEST_MESSAGE and channel in channels and _follow(file, position + at, size):
                return int(position + at)
        position += count
        window = min(4 * window, _WINDOW)


def _is_chunk(data: bytes, at: int, position: int, size: int) -> bool:
    (length,) = struct.unpack_from("<Q", data, at + 1)
    start, end, unpacked, _, name_length = CHUNK.unpack_from(data, at + HEAD.size)
    name = data[at + _NAME_LENGTH + 4 :][:name_length] if name_length <= len(b"zstd") else b"?"
    if name not in _NAMES or start > end or unpacked > MAX_BLOCK or position + HEAD.size + length > size:
        return False
    (packed,) = struct.unpack_from("<Q", data, at + _NAME_LENGTH + 4 + name_length)
    return bool(length == CHUNK.size + name_length + 8 + packed and (name or packed == unpacked))


def _follow(file: int, position: int, size: int) -> bool:
    """Return whether whole records follow each other from here on."""
    for _ in range(3):  # so many whole records in a row do not occur by accident in noise
        head = os.pread(file, HEAD.size, position)
        if len(head) < HEAD.size:
            return False
        opcode, length = HEAD.unpack(head)
        position += HEAD.size + length
        if not Opcode.HEADER <= opcode <= Opcode.DATA_END or position > size:
            return False
        if opcode == Opcode.DATA_END:
            return True
    return True
