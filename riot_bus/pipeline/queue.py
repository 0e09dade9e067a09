"""Emissions in the order in which they fall due."""

from __future__ import annotations

from heapq import heappop, heappush
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from riot_bus.pipeline.runner import Emission


class EmissionQueue:
    """A heap by due time; emissions that fall due together leave in the order of their arrival."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, Emission]] = []
        self._order = 0

    def __len__(self) -> int:
        return len(self._heap)

    def push(self, *emissions: Emission) -> None:
        """Add emissions, such as `*result.emissions`."""
        for emission in emissions:
            heappush(self._heap, (emission.due, self._order, emission))
            self._order += 1

    def pop_due(self, now: int | None = None) -> list[Emission]:
        """Remove and return all emissions due at `now` or earlier, all that are left when `now` is None."""
        due = []
        while self._heap and (now is None or self._heap[0][0] <= now):
            due.append(heappop(self._heap)[2])
        return due

    def next_due(self) -> int | None:
        """Return when the next emission falls due, None when the queue is empty."""
        return self._heap[0][0] if self._heap else None
