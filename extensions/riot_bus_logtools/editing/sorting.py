"""Sorts messages of blocks that overlap in time, in bounded memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from riot_bus.log.engine.blocks import TIMES
from riot_bus.log.engine.limits import DEFAULT_LIMITS
from riot_bus_logtools.editing.batch import Batch, gathered

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Sorter:
    """Holds messages until no earlier ones can follow; the order is stable.

    If too many have to be held, the earliest of them are released anyway: a reader sorts by time in any case.

    Args:
        most: Most bytes to hold.
    """

    def __init__(self, most: int = DEFAULT_LIMITS.held) -> None:
        self._pending: list[tuple[tuple[int, int], Batch]] = []
        self._most = most
        self._held = 0

    def add(self, rank: tuple[int, int], batch: Batch) -> None:
        """Add messages.

        Args:
            rank: Rank of the batch; of messages of equal time, those of lower rank come first.
            batch: Messages, in any order.
        """
        if len(batch):
            self._pending.append((rank, batch.by_time()))
            self._held += _weight(batch)

    def ready(self, bound: int | None) -> Batch | None:
        """Return the messages that can be released, sorted by time; None if there are none.

        Args:
            bound: Earliest time of the messages that follow; None if none follow.
        """
        limit = TIMES if bound is None else bound
        if self._held > self._most:
            limit = max(limit, self._median())
        parts: list[tuple[tuple[int, int], Batch]] = []
        kept: list[tuple[tuple[int, int], Batch]] = []
        for rank, batch in self._pending:
            count = len(batch)
            if limit < TIMES:
                count = int(np.searchsorted(batch.time, np.uint64(max(0, limit)), side="left"))
            if count == len(batch):
                parts.append((rank, batch))
            else:
                if count:
                    parts.append((rank, batch.take(slice(0, count))))
                kept.append((rank, batch.take(slice(count, None)) if count else batch))
        self._pending = kept
        self._held = sum(_weight(batch) for _, batch in kept)
        if not parts:
            return None
        parts.sort(key=lambda part: part[0])
        return gathered([batch for _, batch in parts]).by_time()

    def _median(self) -> int:
        times: NDArray[np.uint64] = np.concatenate([batch.time for _, batch in self._pending])
        return int(np.partition(times, len(times) // 2)[len(times) // 2]) + 1


def _weight(batch: Batch) -> int:
    return batch.weight + 64 * len(batch)  # its arrays take 28 to 48 bytes a message, extras more
