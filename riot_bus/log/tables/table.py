"""Reads fields of a log as numpy arrays: `columns` at once, `iter_columns` piece by piece."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riot_bus.log.engine.limits import DEFAULT_LIMITS
from riot_bus.log.loss import Loss
from riot_bus.log.reader import LogReader
from riot_bus.log.tables.blocks import LoadedBlock, load_ahead
from riot_bus.log.tables.plan import Feed, chosen_rows, log_registry, plan_columns
from riot_bus.types.bulk import gather, join
from riot_bus.types.payloads import Gathered
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One field of n messages, sorted by time and, at equal times, by position in the file.

    Attributes:
        selector: The selector as it was given.
        field: Path of the field.
        keys: Zenoh keys of the messages (topics for a ROS bag); more than one only if the selector has wildcards, or
            a topic several keys.
        times: Times of reception, nanoseconds since the Unix epoch, int64, shape (n,).
        publish_times: Times at the source, in the same form; the time of reception where it is unknown.
        values: Values in the field's own type, shape (n,): bool, int8 ... uint64, float32, float64, or object for
            text, bytes and mixtures.
        valid: Whether there is a value, shape (n,); without one, a float is NaN, a number 0, an object None.
        key: Index of each message's key in `keys`, shape (n,).
        order: Number that increases with the message's position in the file, shape (n,); the same in all columns.
    """

    selector: str
    field: str
    keys: tuple[str, ...]
    times: NDArray[np.int64]
    publish_times: NDArray[np.int64]
    values: NDArray[Any]
    valid: NDArray[np.bool_]
    key: NDArray[np.uint16]
    order: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.times)


class Columns(dict[str, Column]):
    """Columns by selector; `loss` says which parts of the log could not be read (so far)."""

    def __init__(self, found: Mapping[str, Column], loss: Loss) -> None:
        super().__init__(found)
        self.loss = loss


class _Rows(NamedTuple):
    """Some messages' values, in the order of the file."""

    times: NDArray[np.int64]
    order: NDArray[np.int64]
    published: NDArray[np.int64]
    found: Gathered
    key: NDArray[np.uint16]

    @property
    def weight(self) -> int:
        values = self.found.values
        size = len(self.times) * (8 + 8 + 8 + 2 + 1 + values.itemsize)
        if values.dtype == np.object_:
            size += sum(map(sys.getsizeof, {id(value): value for value in values.tolist()}.values()))
        return size

    def take(self, rows: Any) -> _Rows:
        found = Gathered(self.found.values[rows], self.found.valid[rows])
        return _Rows(self.times[rows], self.order[rows], self.published[rows], found, self.key[rows])


def columns(
    path: Path | str,
    selectors: Sequence[str],
    *,
    start: int | None = None,
    end: int | None = None,
    memory: int = DEFAULT_LIMITS.chunk,
    registry: TypeRegistry | None = None,
    threads: int | None = None,
    salvage: bool = False,
) -> Columns:
    """Read fields of a log's delivered messages into arrays.

    Fields of fixed layout are decoded in bulk, JSON and MessagePack message by message.

    Args:
        path: Path of the log; a damaged one is read as far as possible.
        selectors: Such as `/odom:pose.pose.position.x`, `/scan:len(ranges)` or `robot/*/state:speed where mode == 2`.
        start: Earliest time, nanoseconds.
        end: Latest time (exclusive), nanoseconds.
        memory: Bytes that arrays and decompressed chunks may take together; the file may be larger. A larger chunk is
            counted as damaged.
        registry: Types that the log does not define.
        threads: Number of threads for decompression, 0 for none; by default one per processor, at most four.
        salvage: Whether messages of damaged chunks are taken as far as an index confirms them.

    Returns:
        A `Column` for each selector.

    Raises:
        ConfigError: The file is not a log, a selector does not fit it, a type is unknown, or the arrays would need more
            than `memory`.
        PayloadError: A type has no such field.
    """
    with LogReader(path, salvage=salvage) as reader:
        work = _Work(reader, selectors, registry)
        held = 0
        pending: list[list[_Rows]] = [[] for _ in work.wishes]
        for block in work.blocks(start, end, memory, 4, threads):
            for place, rows in work.rows(block):
                held += rows.weight
                pending[place].append(rows)
            if 2 * held > memory:
                raise ConfigError(
                    f"these columns need more than memory = {memory} bytes",
                    where=reader.path,
                    hint="use iter_columns, give start and end, or more memory",
                )
        return work.columns(_split(pending, None)[0])


def iter_columns(
    path: Path | str,
    selectors: Sequence[str],
    *,
    start: int | None = None,
    end: int | None = None,
    memory: int = DEFAULT_LIMITS.held,
    registry: TypeRegistry | None = None,
    threads: int | None = None,
    salvage: bool = False,
) -> Iterator[Columns]:
    """Yield the result of `columns` piece by piece, in order of time, for logs of any size.

    The type of the values of JSON and MessagePack fields may differ from piece to piece. If sorting the chunks that
    overlap in time would need more than `memory`, messages are yielded late and counted in `loss.unsorted`.
    """
    with LogReader(path, salvage=salvage) as reader:
        yield from column_parts(
            reader, selectors, start=start, end=end, memory=memory, registry=registry, threads=threads
        )


def column_parts(
    reader: LogReader,
    selectors: Sequence[str],
    *,
    start: int | None = None,
    end: int | None = None,
    memory: int = DEFAULT_LIMITS.held,
    registry: TypeRegistry | None = None,
    threads: int | None = None,
) -> Iterator[Columns]:
    """Yield what `iter_columns` yields, for a log that is already open."""
    work = _Work(reader, selectors, registry)
    pending: list[list[_Rows]] = [[] for _ in work.wishes]
    held, bound = 0, 0
    for block in work.blocks(start, end, memory, 2, threads):
        late = [np.zeros(0, np.int64)]
        for place, rows in work.rows(block):
            held += rows.weight
            pending[place].append(rows)
            late.append(rows.order[rows.times < bound])
        reader.lost.unsorted[block.block.number] = len(np.unique(np.concatenate(late)))
        following = work.following.get(block.block.number)
        limit = None if following is None or 2 * held > memory else following
        part, pending = _split(pending, limit)
        held = sum(rows.weight for rows_of in pending for rows in rows_of)
        times = [rows.times[-1] for rows in part if len(rows.times)]
        if times:
            bound = max(bound, int(max(times)))
            yield work.columns(part)
    part, _ = _split(pending, None)
    yield work.columns(part)


class _Work:
    """Plan and state of reading columns from a log."""

    def __init__(self, reader: LogReader, selectors: Sequence[str], registry: TypeRegistry | None) -> None:
        self._reader = reader
        self._registry = log_registry(reader) if registry is None else registry
        self.wishes, self._feeds = plan_columns(reader, selectors, self._registry)
        self._keys: list[dict[str, int]] = [{} for _ in self.wishes]
        for feed in self._feeds:
            for place in feed.wishes:
                self._keys[place].setdefault(feed.source.key, len(self._keys[place]))
        self._low, self._high = 0, 1 << 64
        self.following: dict[int, int] = {}
        """Earliest time in the blocks that are still to come after a block, by its number."""

    def blocks(
        self, start: int | None, end: int | None, memory: int, share: int, threads: int | None
    ) -> Iterator[LoadedBlock]:
        """Yield the blocks that may hold wanted messages, by time; blocks loaded ahead take 1/`share` of `memory`."""
        self._low, self._high = max(start or 0, 0), 1 << 64 if end is None else end
        blocks = self._reader.blocks(self._low, self._high)
        self.following = {one.number: other.start for one, other in pairwise(blocks)}
        if threads is None:  # one thread takes values out of blocks, so more would wait; not measured
            threads = min(len(os.sched_getaffinity(0)), 4)
        return load_ahead(self._reader, blocks, memory=memory // share, threads=threads, largest=memory)

    def rows(self, block: LoadedBlock) -> Iterator[tuple[int, _Rows]]:
        """Yield the index of each wish and its rows in a block."""
        for feed in self._feeds:
            rows = block.rows_of(feed.number, self._low, self._high)
            if len(rows):
                yield from self._of_feed(block, feed, rows)

    def columns(self, part: Sequence[_Rows]) -> Columns:
        """Return columns of sorted rows, one for each wish."""
        return Columns(
            {
                wish.text: Column(
                    wish.text, wish.path, tuple(keys), times, published, found.values, found.valid, key, order
                )
                for wish, keys, (times, order, published, found, key) in zip(self.wishes, self._keys, part, strict=True)
            },
            self._reader.loss,
        )

    def _of_feed(self, block: LoadedBlock, feed: Feed, rows: NDArray[np.int64]) -> Iterator[tuple[int, _Rows]]:
        times, order, published = block.times[rows], block.order(rows), block.published(rows)
        payloads = block.payloads(rows)
        kind = feed.settle(payloads, self._registry)
        for place in feed.wishes:
            wish = self.wishes[place]
            key = np.full(len(rows), self._keys[place][feed.source.key], np.uint16)
            if kind is None:
                nothing = Gathered(np.full(len(rows), np.nan), np.zeros(len(rows), np.bool_))
                if wish.where is None:
                    yield place, _Rows(times, order, published, nothing, key)
            elif wish.where is None:
                yield place, _Rows(times, order, published, gather(kind, payloads, wish.path), key)
            else:
                chosen = chosen_rows(kind, payloads, wish.where)
                found = gather(kind, payloads.take(chosen), wish.path)
                yield place, _Rows(times[chosen], order[chosen], published[chosen], found, key[chosen])


def _joined(parts: Sequence[_Rows]) -> _Rows:
    if len(parts) == 1:
        return parts[0]
    empty = np.zeros(0, np.int64)
    return _Rows(
        np.concatenate([empty, *(part.times for part in parts)]),
        np.concatenate([empty, *(part.order for part in parts)]),
        np.concatenate([empty, *(part.published for part in parts)]),
        join([part.found for part in parts]),
        np.concatenate([empty.astype(np.uint16), *(part.key for part in parts)]),
    )


def _sorted(parts: Sequence[_Rows]) -> _Rows:
    rows = _joined(parts)
    if (rows.times[1:] > rows.times[:-1]).all():
        return rows
    order = np.lexsort((rows.order, rows.times))
    return rows if (order[1:] > order[:-1]).all() else rows.take(order)


def _split(pending: list[list[_Rows]], limit: int | None) -> tuple[list[_Rows], list[list[_Rows]]]:
    """Return the rows earlier than the limit, sorted, and the rows that are still pending."""
    ready: list[_Rows] = []
    rest: list[list[_Rows]] = []
    for parts in pending:
        rows = _sorted(parts)
        if limit is None or not len(rows.times):
            ready.append(rows)
            rest.append([])
            continue
        count = int(np.searchsorted(rows.times, limit))
        ready.append(rows.take(slice(None, count)))
        rest.append([rows.take(slice(count, None))] if count < len(rows.times) else [])
    return ready, rest
