"""One chunk of a log while it is filled: messages, their definitions, and where they stand."""

from __future__ import annotations

import struct
import sys
from array import array
from dataclasses import dataclass

__all__ = ["Chunk", "ChunkBuilder"]

_MESSAGE = struct.Struct("<BQHIQQ")
_INDEX = struct.Struct("<BQHI")
_HEAD = 31
_BODY = 22


@dataclass(frozen=True, slots=True)
class Chunk:
    """A chunk that is complete.

    Attributes:
        data: Its records, uncompressed.
        start: Time of the earliest message, nanoseconds.
        end: Time of the latest message.
        indexes: Message index record of each channel.
        counts: Number of messages of each channel.
        definitions: Those of its records that define schemas and channels.
    """

    data: bytes
    start: int
    end: int
    indexes: dict[int, bytes]
    counts: dict[int, int]
    definitions: bytes


class ChunkBuilder:
    """Takes messages in.

    Attributes:
        size: Bytes so far.
        count: Messages so far.
    """

    def __init__(self) -> None:
        self.size = self.count = 0
        self._parts: list[bytes] = []
        self._definitions: list[bytes] = []
        self._places: dict[int, array[int]] = {}

    def define(self, record: bytes) -> None:
        """Take in a schema or channel record; before the first message that needs it."""
        self._definitions.append(record)
        self._parts.append(record)
        self.size += len(record)

    def add(self, channel: int, sequence: int, time: int, published: int, payload: bytes) -> None:
        """Take in a message; numbers have to fit the format: 16, 32, 64 and 64 bits."""
        length = len(payload)
        self._parts += (_MESSAGE.pack(5, _BODY + length, channel, sequence, time, published), payload)
        try:
            places = self._places[channel]
        except KeyError:
            places = self._places[channel] = array("Q")
        places.append(time)
        places.append(self.size)
        self.size += _HEAD + length
        self.count += 1

    def take(self) -> Chunk:
        """Return what there is, and begin another chunk."""
        times = [places[::2] for places in self._places.values()]
        chunk = Chunk(
            data=b"".join(self._parts),
            start=min(map(min, times), default=0),
            end=max(map(max, times), default=0),
            indexes={channel: _index_record(channel, places) for channel, places in self._places.items()},
            counts={channel: len(places) // 2 for channel, places in self._places.items()},
            definitions=b"".join(self._definitions),
        )
        self.size = self.count = 0
        self._parts, self._definitions, self._places = [], [], {}
        return chunk


def _index_record(channel: int, places: array[int]) -> bytes:
    if sys.byteorder == "big":
        places.byteswap()
    data = places.tobytes()
    return _INDEX.pack(7, 6 + len(data), channel, len(data)) + data
