"""One chunk of a log while it is filled: messages, their definitions, and their positions."""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["LARGE", "MESSAGE_BYTES", "Buffer", "Chunk", "ChunkBuilder", "Draft", "Row"]

MESSAGE_BYTES = 31
"""Bytes of a message besides its payload."""
LARGE = 1 << 16
"""Least bytes of a payload that is treated separately."""
Buffer = bytes | memoryview

_MESSAGE = struct.Struct("<BQHIQQ")
_INDEX = struct.Struct("<BQHI")
_ENTRY = struct.Struct("<QQ")
_BODY = 22  # MCAP's message record without payload: channel, sequence, two times (2 + 4 + 8 + 8)
_PIECE = 1 << 17  # the system allocates and frees larger blocks each time (glibc's default); see packing
_FEW = 8  # numpy's calls cost more than a loop over few messages; a guess
_FIELDS = (
    ("opcode", "u1"),
    ("length", "<u8"),
    ("channel", "<u2"),
    ("sequence", "<u4"),
    ("time", "<u8"),
    ("published", "<u8"),
)


@dataclass(frozen=True, slots=True)
class Chunk:
    """A chunk that is complete.

    Attributes:
        data: Its records, uncompressed, whole or in pieces.
        start: Time of the earliest message, nanoseconds.
        end: Time of the latest message.
        indexes: Message index record of each channel.
        counts: Number of messages of each channel.
        definitions: Records in the data that define schemas and channels.
        large: Payloads of at least `LARGE` bytes.
    """

    data: bytes | tuple[bytes, ...]
    start: int
    end: int
    indexes: dict[int, bytes]
    counts: dict[int, int]
    definitions: bytes
    large: tuple[Buffer, ...] = ()


Row = tuple[int, int, int, int, bytes, dict[str, Any] | None]
"""Channel, sequence, time, publish time, payload and extras of a message."""


class Draft(NamedTuple):
    """The parts of a future chunk; building it takes time, which the writer of messages need not wait for.

    Attributes:
        parts: Heads and payloads of messages, alternating.
        definitions: Schema and channel records.
        extras: Positions of messages, and their extras.
        size: Bytes of all of these.
    """

    parts: list[bytes]
    definitions: list[bytes]
    extras: list[tuple[int, dict[str, Any]]]
    size: int

    def counts(self) -> Counter[int]:
        """Return how many messages there are of each channel."""
        return Counter(_MESSAGE.unpack(head)[2] for head in self.parts[::2])

    def chunk(self) -> Chunk:
        """Return the chunk: definitions, then messages, and an index of them."""
        import numpy as np

        definitions = b"".join(self.definitions)
        if len(self.parts) <= 2 * _FEW:
            return self._chunk_of_few(definitions)
        heads = np.frombuffer(b"".join(self.parts[::2]), np.dtype(list(_FIELDS)))
        lengths = heads["length"].astype(np.int64) + 9
        ends = np.cumsum(lengths)
        order = np.argsort(heads["channel"], kind="stable")
        entries = np.empty((len(heads), 2), "<u8")
        entries[:, 0] = heads["time"]
        entries[:, 1] = ends - lengths + len(definitions)
        entries = entries[order]
        channels, places = np.unique(heads["channel"][order], return_index=True)
        following = [*places.tolist()[1:], len(heads)]
        spans = list(zip(channels.tolist(), places.tolist(), following, strict=True))
        cuts = np.unique(np.searchsorted(ends, np.arange(_PIECE, ends[-1], _PIECE), side="right"))
        return Chunk(
            (definitions, *self._pieces([*cuts.tolist(), len(heads)])),
            int(heads["time"].min()),
            int(heads["time"].max()),
            {channel: _index_record(channel, entries[first:end].tobytes()) for channel, first, end in spans},
            {channel: end - first for channel, first, end in spans},
            definitions,
            tuple(self.parts[2 * place + 1] for place in np.flatnonzero(lengths >= LARGE + MESSAGE_BYTES).tolist()),
        )

    def _chunk_of_few(self, definitions: bytes) -> Chunk:
        """Return the chunk; used for few messages, which are usually large."""
        entries: dict[int, bytes] = {}
        counts: Counter[int] = Counter()
        times, position = [], len(definitions)
        for head in self.parts[::2]:
            _, length, channel, _, time, _ = _MESSAGE.unpack(head)
            entries[channel] = entries.get(channel, b"") + _ENTRY.pack(time, position)
            counts[channel] += 1
            times.append(time)
            position += 9 + length
        indexes = {channel: _index_record(channel, data) for channel, data in entries.items()}
        start, end = min(times, default=0), max(times, default=0)
        large = tuple(payload for payload in self.parts[1::2] if len(payload) >= LARGE)
        return Chunk((definitions, *self.parts), start, end, indexes, dict(counts), definitions, large)

    def _pieces(self, cuts: list[int]) -> Iterator[bytes]:
        """Yield all messages in pieces: large enough to be few, and large payloads without a copy."""
        begin = 0
        for end in cuts:
            if end - begin == 1:
                yield from self.parts[2 * begin : 2 * end]
            elif end > begin:
                yield b"".join(self.parts[2 * begin : 2 * end])
            begin = end


class ChunkBuilder:
    """Collects the messages of a chunk.

    Attributes:
        size: Bytes so far.
    """

    __slots__ = ("_definitions", "_extras", "_parts", "size")

    def __init__(self) -> None:
        import numpy  # noqa: F401 - now: the first chunk must not wait for it

        self.size = 0
        self._parts: list[bytes] = []
        self._definitions: list[bytes] = []
        self._extras: list[tuple[int, dict[str, Any]]] = []

    @property
    def count(self) -> int:
        """Messages so far."""
        return len(self._parts) // 2

    def define(self, record: bytes) -> None:
        """Add a schema or channel record."""
        self._definitions.append(record)
        self.size += len(record)

    def fill(self, rows: Iterator[Row], most: int) -> bool:
        """Add messages until there are `most` bytes and return True, or return False if there are no more messages.

        Args:
            rows: Messages, whose numbers have to fit the format: 16, 32, 64 and 64 bits.
            most: Bytes at which the chunk is full.
        """
        put, pack, size = self._parts.append, _MESSAGE.pack, self.size
        for channel, sequence, time, published, payload, extras in rows:
            if extras is not None:
                self._extras.append((len(self._parts) // 2, extras))
                size += len(extras.get("a", ()))
            length = len(payload)
            put(pack(5, _BODY + length, channel, sequence, time, published))
            put(payload)
            size += MESSAGE_BYTES + length
            if size >= most:
                self.size = size
                return True
        self.size = size
        return False

    def take(self) -> Draft:
        """Return the parts collected so far, and begin another chunk."""
        draft = Draft(self._parts, self._definitions, self._extras, self.size)
        self.size = 0
        self._parts, self._definitions, self._extras = [], [], []
        return draft


def _index_record(channel: int, data: bytes) -> bytes:
    return _INDEX.pack(7, 6 + len(data), channel, len(data)) + data
