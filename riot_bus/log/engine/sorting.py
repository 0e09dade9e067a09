"""Sorts messages of blocks that overlap in time, without looking at those that are not due yet."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from heapq import heappop, heappush, heapreplace
from operator import attrgetter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from riot_bus.log.engine.scan import MessageEntry

_ENTRY_BYTES = 200  # a `MessageEntry`, its integers and its payload's header take about this


@dataclass(slots=True)
class _Run:
    """The messages of one block, sorted by time; those before `place` are released."""

    entries: list[MessageEntry]
    place: int
    weight: int


class OverlapSorter:
    """Holds messages until no earlier ones of other blocks can follow.

    Each message costs about as many steps as the logarithm of the blocks that overlap, however these overlap.
    """

    def __init__(self) -> None:
        self.held = 0
        self._runs: list[tuple[int, int, _Run]] = []

    def add(self, entries: list[MessageEntry], size: int) -> None:
        """Add the messages of a block; the list is sorted in place and kept."""
        if not entries:
            return
        entries.sort()
        run = _Run(entries, 0, size + _ENTRY_BYTES * len(entries))
        self.held += run.weight
        heappush(self._runs, (entries[0].time, entries[0].order, run))

    def release(self, before: int | None = None) -> list[MessageEntry]:
        """Remove and return the messages before this time (None: all), sorted."""
        parts: list[list[MessageEntry]] = []
        runs = self._runs
        while runs and (before is None or runs[0][0] < before):
            run = runs[0][2]
            entries = run.entries
            if before is None or entries[-1].time < before:
                heappop(runs)
                self.held -= run.weight
                parts.append(entries[run.place :] if run.place else entries)
                continue
            end = bisect_left(entries, before, run.place, key=attrgetter("time"))
            parts.append(entries[run.place : end])
            run.place = end
            if 2 * end > len(entries):
                self._shorten(run)
            first = run.entries[run.place]
            heapreplace(runs, (first.time, first.order, run))
        if len(parts) == 1:
            return parts[0]
        found = [entry for part in parts for entry in part]
        found.sort()
        return found

    def _shorten(self, run: _Run) -> None:
        """Discard the messages that are released."""
        del run.entries[: run.place]
        run.place = 0
        self.held -= run.weight
        run.weight = sum(len(entry.payload) + _ENTRY_BYTES for entry in run.entries)
        self.held += run.weight
