"""Begins a slice with the last earlier messages of latched topics, which a late joiner would have received."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from riot_bus.types.capabilities import PublishesAs
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_logtools.editing.batch import Batch, gathered, shifted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from riot_bus.types.model import Adapter
    from riot_bus_logtools.editing.channel_edit import ChannelEdit


class LatchedMessages:
    """Keeps the last messages of latched topics until the slice begins; adapters know which topics these are."""

    def __init__(self, start: int, edits: Sequence[ChannelEdit], adapters: Sequence[Adapter]) -> None:
        self._start = start
        self._depths = [0 if edit.original else _depth(edit, adapters) for edit in edits]
        self._last: dict[int, Batch] = {}
        self._released = False

    def wanted(self, batch: Batch) -> NDArray[np.bool_]:
        """Return which messages of a log `run` needs: all of latched topics, of others those in the slice."""
        latched = np.array(self._depths, np.int64)[batch.edit] > 0
        found: NDArray[np.bool_] = latched | (batch.time >= np.uint64(self._start))
        return found

    def run(self, batch: Batch) -> Batch:
        """Return the messages in the slice, after the latched ones if these are the first; all are sorted by time."""
        early = batch.time < np.uint64(self._start)
        before, inside = batch.where(early), batch.where(~early)
        for number in np.unique(before.edit).tolist():
            same = [self._last[number]] if number in self._last else []
            rows = before.where(before.edit == number)
            self._last[number] = gathered([*same, rows]).take(slice(-self._depths[number], None))
        if self._released or not len(inside):
            return inside
        return gathered([self.rest(), inside])

    def rest(self) -> Batch:
        """Return the latched messages, with the start of the slice as their time; none if already returned."""
        if self._released:
            return gathered([])
        self._released = True
        held = gathered(list(self._last.values())).by_time()
        found = gathered([held.take(slice(None))])
        moved, _ = shifted(found, (np.uint64(self._start) - found.time).astype(np.int64))
        moved.changed = moved.edit.copy()
        return moved


def _depth(edit: ChannelEdit, adapters: Sequence[Adapter]) -> int:
    for adapter in adapters:
        try:
            offer = adapter.offer(edit.topic, name=None, domain=None) if isinstance(adapter, PublishesAs) else None
        except ConfigError:
            continue
        if offer is not None:
            return offer.depth or 0
    return 0
