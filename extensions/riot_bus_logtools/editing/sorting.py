"""Sorts messages of blocks that overlap in time, in bounded memory."""

from __future__ import annotations

from operator import itemgetter

import numpy as np

from riot_bus.log.engine.blocks import TIMES
from riot_bus.log.engine.limits import DEFAULT_LIMITS
from riot_bus_logtools.editing.batch import Batch, gathered


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
