"""Batches of messages, as records in a buffer: records that do not change are moved without being parsed."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.log.engine.blocks import HEAD, MESSAGE_HEAD, SHORTEST_MESSAGE, TIMES, heads_of
from riot_bus.log.engine.limits import DEFAULT_LIMITS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from riot_bus.log.engine.blocks import Block

_CHANNEL_AT, _TIME_AT, _PUBLISHED_AT = HEAD.size, MESSAGE_HEAD - 16, MESSAGE_HEAD - 8  # see blocks.MESSAGE


@dataclass(slots=True, eq=False)
class Batch:
    """A batch of n messages.

    Attributes:
        start: Offset at which each record begins, shape (n,).
        end: Offset at which each record ends, shape (n,).
        edit: Number of the `ChannelEdit` of each message, shape (n,).
        time: Time of each message, nanoseconds, shape (n,).
        extras: Result of `layout.extras_of` for each message, shape (n,); None if no message has extras.
        notes: Changes of each message by interceptors, tuples, shape (n,); None if there are none.
        changed: Number of the edit for which each counts as changed, -1 if it does not, shape (n,); None if none.
        whole: Number of the log, and block, if these are exactly all messages of the block, unchanged; None otherwise.
    """

    buffer: bytes | bytearray
    start: NDArray[np.int64]
    end: NDArray[np.int64]
    edit: NDArray[np.int32]
    time: NDArray[np.uint64]
    extras: NDArray[Any] | None = None
    notes: NDArray[Any] | None = None
    changed: NDArray[np.int32] | None = None
    whole: tuple[int, Block] | None = None

    def __len__(self) -> int:
        return len(self.start)

    @property
    def weight(self) -> int:
        """Bytes of the records."""
        return int((self.end - self.start).sum())

    def take(self, rows: NDArray[Any] | slice) -> Batch:
        """Return some of the messages, by mask, by number or by range."""
        details: Any = [None if each is None else each[rows] for each in (self.extras, self.notes, self.changed)]
        return Batch(self.buffer, self.start[rows], self.end[rows], self.edit[rows], self.time[rows], *details)

    def where(self, mask: NDArray[np.bool_]) -> Batch:
        """Return the messages for which a mask is true; the same batch if these are all."""
        return self if mask.all() else self.take(mask)

    def by_time(self) -> Batch:
        """Return the messages sorted by time (stable); the same batch if it is already sorted."""
        if len(self) < 2 or bool((self.time[1:] >= self.time[:-1]).all()):
            return self
        return self.take(np.argsort(self.time, kind="stable"))

    def writable(self) -> bytearray:
        """Return the buffer, which may then be changed."""
        if not isinstance(self.buffer, bytearray):
            self.buffer = bytearray(self.buffer)
        self.whole = None
        return self.buffer


def with_payloads(batch: Batch, payloads: Mapping[int, bytes]) -> Batch:
    """Return a batch with payloads of other lengths in some rows; these lie behind all others in the buffer."""
    if not payloads:
        return batch
    rows, records = list(payloads), []
    for row, payload in payloads.items():
        begin = int(batch.start[row])
        head = HEAD.pack(batch.buffer[begin], len(payload) + SHORTEST_MESSAGE)
        records.append(head + batch.buffer[begin + HEAD.size : begin + MESSAGE_HEAD] + payload)
    lengths = np.array([len(record) for record in records], np.int64)
    start, end = batch.start.copy(), batch.end.copy()
    end[rows] = len(batch.buffer) + np.cumsum(lengths)
    start[rows] = end[rows] - lengths
    return replace(batch, buffer=b"".join([batch.buffer, *records]), start=start, end=end, whole=None)


def gathered(batches: Sequence[Batch]) -> Batch:
    """Return the messages of all batches, one after the other."""
    filled = [batch for batch in batches if len(batch)]
    if len(filled) == 1:
        return filled[0]
    if not filled:
        return Batch(b"", *(np.zeros(0, kind) for kind in (np.int64, np.int64, np.int32, np.uint64)))  # type: ignore[arg-type]
    pieces: list[memoryview] = []
    for batch in filled:
        view = memoryview(batch.buffer)
        pieces += [view[begin:end] for begin, end in runs_of(batch)]
    lengths = np.concatenate([batch.end - batch.start for batch in filled])
    ends = np.cumsum(lengths)
    return Batch(
        b"".join(pieces),
        ends - lengths,
        ends,
        np.concatenate([batch.edit for batch in filled]),
        np.concatenate([batch.time for batch in filled]),
        _joined([(len(batch), batch.extras) for batch in filled], None, object),
        _joined([(len(batch), batch.notes) for batch in filled], None, object),
        _joined([(len(batch), batch.changed) for batch in filled], -1, np.int32),
    )


def runs_of(batch: Batch) -> list[tuple[int, int]]:
    """Return start and end of each sequence of records without gaps."""
    if not len(batch):
        return []
    breaks = np.flatnonzero(batch.start[1:] != batch.end[:-1])
    begins = batch.start[np.concatenate(([0], breaks + 1))]
    ends = batch.end[np.concatenate((breaks, [len(batch) - 1]))]
    return list(zip(begins.tolist(), ends.tolist(), strict=True))


def shifted(batch: Batch, delta: NDArray[np.int64]) -> tuple[Batch, NDArray[np.bool_]]:
    """Add nanoseconds, shape (n,), to both times; return the batch, changed in place, and whose time is still valid."""
    if not delta.any():
        return batch, np.ones(len(batch), np.bool_)
    buffer = batch.writable()
    heads = heads_of(buffer, batch.start)
    step = delta.astype(np.uint64)  # wraps, as the addition does
    time, published = batch.time + step, heads["published"] + step
    fits = np.where(delta < 0, time <= batch.time, time >= batch.time)
    known = np.where(delta < 0, published <= heads["published"], published >= heads["published"])
    _write(buffer, batch.start + _TIME_AT, time, 8)
    _write(buffer, batch.start + _PUBLISHED_AT, np.where(known, published, time), 8)
    batch.time = time
    if batch.extras is not None:
        for row in np.flatnonzero([extras is not None and "p" in extras for extras in batch.extras]).tolist():
            with suppress(TypeError, ValueError):  # it may hold anything
                moved = int(batch.extras[row]["p"]) + int(delta[row])
                batch.extras[row] = {**batch.extras[row], "p": str(moved)}
    return batch, fits


def renumbered(batch: Batch, rows: NDArray[Any], channels: NDArray[np.uint16]) -> None:
    """Write other channel numbers into the records of some rows."""
    if len(rows):
        _write(batch.writable(), batch.start[rows] + _CHANNEL_AT, channels, 2)


def _write(buffer: bytearray, places: NDArray[np.int64], values: NDArray[Any], size: int) -> None:
    raw = np.frombuffer(buffer, np.uint8)
    data = np.ascontiguousarray(values.astype(f"<u{size}")).view(np.uint8).reshape(-1, size)
    raw[places[:, None] + np.arange(size)] = data


def _joined(parts: Sequence[tuple[int, NDArray[Any] | None]], nothing: Any, kind: Any) -> NDArray[Any] | None:
    if all(part is None for _, part in parts):
        return None
    return np.concatenate([np.full(count, nothing, kind) if part is None else part for count, part in parts])


class Sorter:
    """Holds messages until no earlier ones can follow; the order is stable.

    If more than `most` bytes have to be held, the earliest are released anyway: a reader sorts by time in any case.
    """

    def __init__(self, most: int = DEFAULT_LIMITS.held) -> None:
        self._pending: list[tuple[tuple[int, int], Batch]] = []
        self._most = most
        self._held = 0

    def add(self, rank: tuple[int, int], batch: Batch) -> None:
        """Add messages; of those of equal time, the ones of lower rank come first."""
        if len(batch):
            self._pending.append((rank, batch.by_time()))
            self._held += _weight(batch)

    def ready(self, bound: int | None) -> Batch:
        """Return the messages before a time (None: all), since others may follow there, by time."""
        limit = TIMES if bound is None else bound
        if self._held > self._most:
            times = np.concatenate([batch.time for _, batch in self._pending])
            limit = max(limit, int(np.partition(times, len(times) // 2)[len(times) // 2]) + 1)  # half of them
        parts: list[Batch] = []
        pending, self._pending = sorted(self._pending, key=itemgetter(0)), []
        for rank, batch in pending:
            count = len(batch)
            if limit < TIMES:
                count = int(np.searchsorted(batch.time, np.uint64(max(0, limit)), side="left"))
            parts.append(batch if count == len(batch) else batch.take(slice(0, count)))
            if count < len(batch):
                self._pending.append((rank, batch.take(slice(count, None)) if count else batch))
        self._held = sum(_weight(batch) for _, batch in self._pending)
        return gathered(parts).by_time()


def _weight(batch: Batch) -> int:
    return batch.weight + 64 * len(batch)  # its arrays take 28 to 48 bytes a message, extras more
