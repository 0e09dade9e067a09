"""Loads blocks of a log as numpy arrays: threads decompress ahead, and records are found without a loop."""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.log.engine.blocks import MESSAGE_HEAD, NUMBERS, SHORTEST_MESSAGE, heads_of
from riot_bus.types.payloads import Payloads

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from concurrent.futures import Future

    from numpy.typing import NDArray

    from riot_bus.log.engine.blocks import Block, Records
    from riot_bus.log.reader import LogReader

LATEST = np.iinfo(np.int64).max  # times in MCAP go up to 2^64 - 1


@dataclass(frozen=True, slots=True, eq=False)
class LoadedBlock:
    """One block's messages, in the order of the file.

    Attributes:
        heads: Header before each message's payload, shape (n,).
        times: Time of each message, nanoseconds, shape (n,); -1 beyond the year 2262.
    """

    block: Block
    records: Records
    heads: NDArray[Any]
    times: NDArray[np.int64]

    @property
    def channels(self) -> NDArray[np.uint16]:
        """Channel of each message, shape (n,)."""
        channels: NDArray[np.uint16] = self.heads["channel"]
        return channels

    def rows_of(self, channel: int, low: int, high: int) -> NDArray[np.int64]:
        """Return the indices of a channel's messages with times in [low, high), in nanoseconds."""
        chosen = self.channels == channel
        if low > 0 or high <= LATEST:
            chosen &= (self.times >= low) & (self.times < high)
        else:
            chosen &= self.times >= 0
        return np.flatnonzero(chosen)

    def by_channel(self) -> Iterator[tuple[int, NDArray[np.int64]]]:
        """Yield each channel, and the indices of its messages, without a look at all messages for each channel."""
        order = np.argsort(self.channels, kind="stable")
        order = order[self.times[order] >= 0]
        channels = self.channels[order]
        ends = np.flatnonzero(channels[1:] != channels[:-1]) + 1
        for begin, end in pairwise([0, *ends.tolist(), len(order)] if len(order) else ()):
            yield int(channels[begin]), order[begin:end]

    def order(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return numbers that sort messages, of any block, by their place in the file."""
        numbers = self.records.numbers
        return (self.block.number << 32) + (rows if numbers is None else numbers[rows])

    def published(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the publish times of these rows, as stored in the file."""
        return _as_times(self.heads["published"][rows])

    def payloads(self, rows: NDArray[np.int64]) -> Payloads:
        """Return the payloads of these rows."""
        return Payloads(self.records.data, self.records.messages[rows] + MESSAGE_HEAD, self.lengths()[rows])

    def lengths(self) -> NDArray[np.int64]:
        """Return the payload size of each message in bytes, shape (n,)."""
        lengths: NDArray[np.int64] = self.heads["length"].astype(np.int64) - SHORTEST_MESSAGE
        return lengths


def load_ahead(
    reader: LogReader, blocks: Sequence[Block], *, memory: int, threads: int, largest: int | None = None
) -> Iterator[LoadedBlock]:
    """Yield blocks in the given order, loading some of them ahead; damaged ones are counted.

    Damaged blocks are left out, except for what the reader salvages if it was told to.

    Args:
        reader: The log, which must stay open during the iteration; it counts losses.
        blocks: The blocks, in the wanted order.
        memory: Bytes that waiting blocks may take.
        threads: Number of blocks that are decompressed at the same time; 0 to load none ahead.
        largest: Bytes that a single block may take, by default `memory`; larger ones are counted as damaged.
    """
    limit = memory if largest is None else largest
    known = np.zeros(NUMBERS, np.bool_)
    known[list(reader.sources())] = True
    threads = threads if len(blocks) > 1 else 0
    ahead: deque[tuple[Block, int, Future[LoadedBlock] | None]] = deque()
    held, following = 0, 0
    with ThreadPoolExecutor(max(threads, 1), thread_name_prefix="riot-columns") as pool:
        try:
            while ahead or following < len(blocks):
                while following < len(blocks) and len(ahead) <= 2 * threads:
                    block = blocks[following]
                    size = min(limit, reader.claimed_size(block)) if threads else 0
                    if ahead and held + size > memory:
                        break
                    in_pool = size > 1 << 14  # handing over a smaller block takes longer than loading it
                    ahead.append((block, size, pool.submit(_load, reader, block, limit) if in_pool else None))
                    held += size
                    following += 1
                block, size, future = ahead.popleft()
                loaded: LoadedBlock | None
                try:
                    loaded = _load(reader, block, limit) if future is None else future.result()
                except ValueError as error:
                    rest = reader.salvage(block, error, memory=limit)
                    loaded = None if rest is None else _arrays(block, rest)
                if loaded is not None:
                    _account(reader, loaded, known)
                    yield loaded
                del loaded, future  # before others are loaded: memory holds one block besides those ahead
                held -= size
        finally:
            for _, _, future in ahead:
                if future is not None:
                    future.cancel()


def _load(reader: LogReader, block: Block, memory: int) -> LoadedBlock:
    return _arrays(block, reader.load(block, memory=memory))


def _account(reader: LogReader, loaded: LoadedBlock, known: NDArray[np.bool_]) -> None:
    """Add the definitions in a block to those of the log, and count messages of unknown channels or late times.

    A function of its own, so that its arrays are freed before another block is decompressed into their place.
    """
    reader.define(loaded.records)
    lost = ~known[loaded.channels] | (loaded.times < 0)
    reader.count_unknown(loaded.block, int(np.count_nonzero(lost)))


def _arrays(block: Block, records: Records) -> LoadedBlock:
    heads = heads_of(records.data, records.messages)
    return LoadedBlock(block, records, heads, _as_times(heads["time"]))


def _as_times(numbers: NDArray[Any]) -> NDArray[np.int64]:
    late = numbers > LATEST
    times = numbers.astype(np.int64)
    if late.any():
        times[late] = -1
    return times
