"""Collects one chunk of a log: messages, their definitions, and an index of them."""

from __future__ import annotations

import struct
from collections import Counter, defaultdict
from dataclasses import dataclass
from itertools import pairwise, starmap
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.log.engine.blocks import HEAD, MESSAGE, MESSAGE_HEAD, SHORTEST_MESSAGE, head_type

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from numpy.typing import NDArray

LARGE = 1 << 16
"""Least bytes of a payload that is treated separately."""
Buffer = bytes | memoryview

_INDEX, _ENTRY = struct.Struct("<BQHI"), struct.Struct("<QQ")
_FEW = 128
"""Messages of a chunk for which numpy's calls cost more than a loop: 50 us with 128 either way, 44 and 4 with one."""
_PIECE = 1 << 17  # the system allocates and frees larger blocks each time (glibc's default); see packing


@dataclass(frozen=True, slots=True)
class Chunk:
    """A chunk that is complete.

    Attributes:
        data: Its records, uncompressed, in pieces.
        start: Time of the earliest message, nanoseconds.
        indexes: Message index record of each channel.
        counts: Number of messages of each channel.
        definitions: Records in the data that define schemas and channels.
        large: Payloads of at least `LARGE` bytes.
    """

    data: tuple[bytes, ...]
    start: int
    end: int
    indexes: dict[int, bytes]
    counts: dict[int, int]
    definitions: bytes
    large: tuple[Buffer, ...] = ()


class Companions(NamedTuple):
    """The records that belong to a chunk, and stand right before it.

    Attributes:
        extras: Data of the attachment `riot_bus.extras`; empty if there is none.
        note: Name and mapping of a metadata record, None if there is none.
    """

    extras: bytes = b""
    note: tuple[str, Mapping[str, str]] | None = None


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
        return Counter(MESSAGE.unpack(head)[2] for head in self.parts[::2])

    def chunk(self) -> Chunk:
        """Return the chunk: definitions, then messages, and an index of them."""
        if len(self.parts) <= 2 * _FEW:
            return self._chunk_of_few(b"".join(self.definitions))
        import numpy as np

        heads = np.frombuffer(b"".join(self.parts[::2]), head_type())
        lengths = heads["length"].astype(np.int64) + HEAD.size
        ends = np.cumsum(lengths)
        cuts = np.unique(np.searchsorted(ends, np.arange(_PIECE, lengths.sum(), _PIECE), side="right"))
        pieces = self._pieces([*cuts.tolist(), len(heads)])
        places = np.flatnonzero(lengths >= LARGE + MESSAGE_HEAD).tolist()
        large = tuple(self.parts[2 * place + 1] for place in places)
        return chunk_of(b"".join(self.definitions), pieces, heads["channel"], heads["time"], lengths, large)

    def _chunk_of_few(self, definitions: bytes) -> Chunk:
        entries: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)
        position = len(definitions)
        for head in self.parts[::2]:
            _, length, channel, _, time, _ = MESSAGE.unpack(head)
            entries[channel].append((time, position))
            position += HEAD.size + length
        times = [time for each in entries.values() for time, _ in each] or [0]
        indexes = {number: _index(number, b"".join(starmap(_ENTRY.pack, each))) for number, each in entries.items()}
        large = tuple(payload for payload in self.parts[1::2] if len(payload) >= LARGE)
        counts = {number: len(each) for number, each in entries.items()}
        return Chunk((definitions, *self.parts), min(times), max(times), indexes, counts, definitions, large)

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
    """Collects the messages of a chunk."""

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

        The numbers of a message have to fit the format: 16, 32, 64 and 64 bits.
        """
        put, pack, size = self._parts.append, MESSAGE.pack, self.size
        for channel, sequence, time, published, payload, extras in rows:
            if extras is not None:
                self._extras.append((len(self._parts) // 2, extras))
                size += len(extras.get("a", ()))
            length = len(payload)
            put(pack(5, SHORTEST_MESSAGE + length, channel, sequence, time, published))
            put(payload)
            size += MESSAGE_HEAD + length
            if size >= most:
                self.size = size
                return True
        self.size = size
        return False

    def end(self) -> Draft:
        """Return the parts collected so far, and begin another chunk."""
        draft = Draft(self._parts, self._definitions, self._extras, self.size)
        self.size = 0
        self._parts, self._definitions, self._extras = [], [], []
        return draft


def chunk_of(
    definitions: bytes,
    pieces: Iterable[bytes],
    channels: NDArray[Any],
    times: NDArray[Any],
    lengths: NDArray[Any],
    large: tuple[Buffer, ...],
) -> Chunk:
    """Return a chunk: definitions, then messages, and an index of them.

    Args:
        definitions: Schema and channel records.
        pieces: Records of the messages, cut anywhere.
        channels: Channel of each message, shape (n,).
        times: Time of each message, nanoseconds, shape (n,).
        lengths: Length of each message's record, shape (n,).
        large: Payloads of at least `LARGE` bytes.
    """
    offsets = lengths.cumsum() - lengths + len(definitions)
    indexes, counts = indexes_of(channels, times, offsets)
    start, end = (int(times.min()), int(times.max())) if len(times) else (0, 0)
    return Chunk((definitions, *pieces), start, end, indexes, counts, definitions, large)


def indexes_of(
    channels: NDArray[Any], times: NDArray[Any], offsets: NDArray[Any]
) -> tuple[dict[int, bytes], dict[int, int]]:
    """Return the message index record and the number of messages of each channel of a chunk.

    The messages are given as arrays of shape (n,): channel, time in nanoseconds, offset of the record in the chunk.
    """
    import numpy as np

    order = np.argsort(channels, kind="stable")
    entries = np.empty((len(channels), 2), "<u8")
    entries[:, 0], entries[:, 1] = times, offsets
    entries = entries[order]
    numbers, places = np.unique(channels[order], return_index=True)
    borders = [*places.tolist(), len(channels)]
    spans = [(number, *span) for number, span in zip(numbers.tolist(), pairwise(borders), strict=True)]
    return (
        {number: _index(number, entries[first:end].tobytes()) for number, first, end in spans},
        {number: end - first for number, first, end in spans},
    )


def _index(channel: int, entries: bytes) -> bytes:
    return _INDEX.pack(7, 6 + len(entries), channel, len(entries)) + entries
