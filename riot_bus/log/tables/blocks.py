"""Blocks of a log as numpy arrays: decompressed ahead by threads, their records found without a loop over messages."""

from __future__ import annotations

import os
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.opcode import Opcode

from riot_bus.log.engine.blocks import (
    CHUNK,
    HEAD,
    SHORTEST_MESSAGE,
    Records,
    packed_size,
    read_block,
    records_of,
)
from riot_bus.types.payloads import Payloads

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from concurrent.futures import Future

    from numpy.typing import NDArray

    from riot_bus.log.engine.blocks import Block
    from riot_bus.log.reader import LogReader

__all__ = ["LoadedBlock", "load_ahead"]

_MESSAGE = np.dtype(
    {
        "names": ["length", "channel", "time", "published"],
        "formats": ["<u8", "<u2", "<u8", "<u8"],
        "offsets": [1, 9, 15, 23],
        "itemsize": HEAD.size + SHORTEST_MESSAGE,
    }
)
"""The part of a message record before its payload."""
_LATEST = (1 << 63) - 1  # the largest int64 of numpy; times in MCAP go up to 2^64 - 1
_SMALL = 1 << 14  # handing a block of this size to a thread takes longer than loading it


@dataclass(frozen=True, slots=True, eq=False)
class LoadedBlock:
    """One block's messages, in the order of the file.

    Attributes:
        block: The block that was read.
        data: The records of the block.
        places: Offset of each message's record in `data`, shape (n,).
        heads: Header before each message's payload, shape (n,).
        times: Time of each message, nanoseconds, shape (n,); -1 beyond the year 2262.
        numbers: Position of each message in the block as it was written, shape (n,); None for 0, 1, 2 ...
    """

    block: Block
    data: bytes
    places: NDArray[np.int64]
    heads: NDArray[Any]
    times: NDArray[np.int64]
    numbers: NDArray[np.int64] | None = None

    @property
    def channels(self) -> NDArray[np.uint16]:
        """Channel of each message, shape (n,)."""
        channels: NDArray[np.uint16] = self.heads["channel"]
        return channels

    def rows_of(self, channel: int, low: int, high: int) -> NDArray[np.int64]:
        """Return the indices of a channel's messages with times in [low, high), in nanoseconds."""
        chosen = self.channels == channel
        if low > 0 or high <= _LATEST:
            chosen &= (self.times >= low) & (self.times < high)
        else:
            chosen &= self.times >= 0
        return np.flatnonzero(chosen)

    def order(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return numbers that sort messages, of any block, by their place in the file."""
        return (self.block.number << 32) + (rows if self.numbers is None else self.numbers[rows])

    def published(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the publish times of these rows, as stored in the file."""
        return _as_times(self.heads["published"][rows])

    def payloads(self, rows: NDArray[np.int64]) -> Payloads:
        """Return the payloads of these rows."""
        return Payloads(self.data, self.places[rows] + _MESSAGE.itemsize, self.lengths()[rows])

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
    known = np.zeros(1 << 16, np.bool_)
    known[list(reader.sources())] = True
    if threads < 1 or len(blocks) < 2:
        for block in blocks:
            try:
                loaded = _load(reader, block, limit)
            except ValueError as error:
                yield from _rest(reader, block, error, limit, known)
            else:
                yield _take(reader, *loaded, known)
                del loaded
        return
    waiting: deque[tuple[Block, int, Future[tuple[LoadedBlock, Records]] | None]] = deque()
    held, following = 0, 0
    with ThreadPoolExecutor(threads, thread_name_prefix="riot-columns") as pool:
        try:
            while waiting or following < len(blocks):
                while following < len(blocks) and len(waiting) <= 2 * threads:
                    block = blocks[following]
                    size = min(limit, _claimed(reader.file, block))
                    if waiting and held + size > memory:
                        break
                    ahead = pool.submit(_load, reader, block, limit) if size > _SMALL else None
                    waiting.append((block, size, ahead))
                    held += size
                    following += 1
                block, size, future = waiting.popleft()
                try:
                    loaded = _load(reader, block, limit) if future is None else future.result()
                except ValueError as error:
                    yield from _rest(reader, block, error, limit, known)
                else:
                    yield _take(reader, *loaded, known)
                    del loaded
                del future
                held -= size
        finally:
            for _, _, future in waiting:
                if future is not None:
                    future.cancel()


def _load(reader: LogReader, block: Block, memory: int) -> tuple[LoadedBlock, Records]:
    data = read_block(reader.file, block, reader.limits, memory=memory)
    records = records_of(data, reader.limits, cut=block.cut)
    return _arrays(block, data, records), records


def _rest(
    reader: LogReader, block: Block, error: ValueError, limit: int, known: NDArray[np.bool_]
) -> Iterator[LoadedBlock]:
    """Count a block as damaged, and yield what is salvaged of it."""
    reader.count_damage(block, error)
    rest = reader.rest_of(block, memory=limit)
    if rest is not None:
        yield _take(reader, _arrays(block, rest.data, rest.records, rest.places), rest.records, known)


def _arrays(block: Block, data: bytes, records: Records, numbers: NDArray[np.int64] | None = None) -> LoadedBlock:
    heads = _heads(data, records.messages)
    return LoadedBlock(block, data, records.messages, heads, _as_times(heads["time"]), numbers)


def _take(reader: LogReader, block: LoadedBlock, records: Records, known: NDArray[np.bool_]) -> LoadedBlock:
    for opcode, start, end in records.others:
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            reader.define(opcode, block.data[start:end])
    lost = ~known[block.channels] | (block.times < 0)
    reader.count_unknown(block.block, int(np.count_nonzero(lost)))
    return block


def _claimed(file: int, block: Block) -> int:
    """Return how many bytes a block claims to have once it is decompressed."""
    if not block.chunked:
        return block.body.length
    try:
        head = os.pread(file, CHUNK.size, block.body.offset)
    except OSError:
        return 0
    return packed_size(head) if len(head) == CHUNK.size else 0


def _heads(data: bytes, places: NDArray[np.int64]) -> NDArray[Any]:
    """Return the headers of the messages at these offsets, which need not be aligned."""
    size = _MESSAGE.itemsize
    stride = _stride(places)
    if stride:
        heads = np.ndarray((len(places),), f"V{size}", data, int(places[0]), (stride,)).copy()
    elif len(places):
        heads = np.ndarray((len(data) - size + 1,), f"V{size}", data, 0, (1,))[places]
    else:
        heads = np.empty(0, f"V{size}")
    return heads.view(_MESSAGE)


def _stride(places: NDArray[np.int64]) -> int:
    """Return the distance between successive offsets, 0 if it varies."""
    steps = np.diff(places)
    return int(steps[0]) if len(steps) and (steps == steps[0]).all() else 0


def _as_times(numbers: NDArray[Any]) -> NDArray[np.int64]:
    late = numbers > _LATEST
    times = numbers.astype(np.int64)
    if late.any():
        times[late] = -1
    return times
