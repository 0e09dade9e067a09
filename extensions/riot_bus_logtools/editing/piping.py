"""Passes messages of an edit through interceptors, and merges the results with the messages that skip them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.log import layout
from riot_bus.log.engine.blocks import MESSAGE_HEAD, TIMES, heads_of, message_bytes
from riot_bus.log.engine.scan import MessageEntry
from riot_bus.log.reader import message_of
from riot_bus_logtools.editing.batch import Batch, gathered, with_records

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.pipeline.event import Change
    from riot_bus.pipeline.runner import Emission, Pipeline
    from riot_bus_logtools.editing.channel_table import ChannelTable

_MOST_BYTES = 1 << 26  # of delayed messages; beyond it they are written early, as readers sort anyway


@dataclass(frozen=True, slots=True)
class _Item:
    record: bytes
    edit: int
    extras: dict[str, Any] | None
    notes: tuple[Change, ...] | None
    changed: int


class Piping:
    """Feeds a pipeline, and holds its delayed messages until they are due."""

    def __init__(self, pipeline: Pipeline, table: ChannelTable, refuse: Callable[[str], None]) -> None:
        self._pipeline = pipeline
        self._edits = table.edits
        self._edit_of_key = table.edit_of_key
        self._refuse = refuse
        self._later: list[tuple[int, int, int, _Item]] = []
        self._later_bytes = self._held = 0
        self._order = 0

    def rest(self) -> Batch:
        """Return the messages that are still held."""
        return self._merged(gathered([]), np.zeros(0, np.int64), TIMES)

    def run(self, batch: Batch, bound: int | None) -> Batch:
        """Return the messages to write, sorted by time.

        Args:
            batch: Messages, sorted by time.
            bound: Earliest time of the messages that follow; None if none follow.
        """
        base = self._order
        self._order += 2 * len(batch) + 2
        piped = np.array([edit.piped for edit in self._edits], np.bool_)
        kept = np.ones(len(batch), np.bool_)
        replaced: dict[int, _Item] = {}
        noted: dict[int, tuple[Change, ...]] = {}
        rows = np.flatnonzero(piped[batch.edit]).tolist() if len(batch) else []
        heads = heads_of(batch.buffer, batch.start[rows]) if rows else None
        for place, row in enumerate(rows):
            assert heads is not None
            kept[row] = self._feed(batch, row, heads[place], base + 2 * row, replaced, noted)
        batch = _with_notes(_with_replaced(batch, replaced), noted).where(kept)
        order = base + 2 * np.flatnonzero(kept)
        return self._merged(batch, order, TIMES if bound is None else bound - 1)

    def _feed(
        self,
        batch: Batch,
        row: int,
        head: Any,
        order: int,
        replaced: dict[int, _Item],
        noted: dict[int, tuple[Change, ...]],
    ) -> bool:
        """Feed one message; return whether it stays at its position, changed or not."""
        edit = self._edits[int(batch.edit[row])]
        message = message_of(_entry(batch, row, head), edit.source)
        before: tuple[Change, ...] = () if batch.notes is None else batch.notes[row] or ()
        own = int(batch.edit[row])
        stays = emitted = False
        for emission in self._pipeline.feed(message).emissions:
            changes = emission.changes if emission.original is None else before + emission.changes
            same_key = emission.message.key == message.key
            target = own if same_key and emission.original is not None else self._edit_of_key(emission.message)
            if emission.original is not None and same_key and emission.due == message.time and not emitted:
                emitted = stays = True
                if emission.message is not message:
                    replaced[row] = self._item(emission, changes, target, changed=own)
                elif emission.changes:
                    noted[row] = changes
                continue
            is_first = emission.original is not None and not emitted
            emitted = emitted or is_first
            self._hold(self._item(emission, changes, target, changed=own if is_first else -1), emission.due, order + 1)
        if not emitted:
            edit.counts.kept -= 1
        return stays

    def _hold(self, item: _Item, due: int, order: int) -> None:
        if not item.record:
            self._refuse(self._edits[item.edit].topic.name)
            if item.changed >= 0:
                self._edits[item.changed].counts.kept -= 1
            return
        self._edits[item.edit].counts.added += item.changed < 0
        self._held += 1
        heappush(self._later, (due, order, self._held, item))
        self._later_bytes += len(item.record)

    def _item(self, emission: Emission, notes: tuple[Change, ...], number: int, *, changed: int) -> _Item:
        """Return what to write for an emission; the record is empty if its time does not fit into a log."""
        target = self._edits[number].target
        assert target is not None
        if not 0 <= emission.due < TIMES:
            return _Item(b"", number, None, None, changed)
        message = emission.message_when_due()
        extras = layout.extras_of(message, target.source.constants)
        published = message.publish_time
        if published is None or not 0 <= published < TIMES:
            published = message.time
        elif extras is not None and not target.source.own:
            extras.pop("p", None)  # files of other tools hold it in the record
        sequence = message.sequence & 0xFFFFFFFF
        record = message_bytes(target.channel.id, sequence, message.time, published, message.payload)
        return _Item(record, number, extras or None, notes or None, changed)

    def _merged(self, batch: Batch, order: Any, until: int) -> Batch:
        items: list[tuple[int, int, int, _Item]] = []
        while self._later and (self._later[0][0] <= until or self._later_bytes > _MOST_BYTES):
            items.append(heappop(self._later))
            self._later_bytes -= len(items[-1][3].record)
        if not items:
            return batch
        later = _of_items([(due, item) for due, _, _, item in items])
        both = gathered([batch, later])
        orders = np.concatenate((order, np.array([each for _, each, _, _ in items], np.int64)))
        return both.take(np.lexsort((orders, both.time)))


def _entry(batch: Batch, row: int, head: Any) -> MessageEntry:
    payload = bytes(batch.buffer[int(batch.start[row]) + MESSAGE_HEAD : int(batch.end[row])])
    extras = None if batch.extras is None else batch.extras[row]
    channel, sequence, published = int(head["channel"]), int(head["sequence"]), int(head["published"])
    return MessageEntry(int(batch.time[row]), row, channel, sequence, published, payload, extras)


def _of_items(items: Sequence[tuple[int, _Item]]) -> Batch:
    lengths = np.array([len(item.record) for _, item in items], np.int64)
    ends = np.cumsum(lengths)
    extras, notes = np.full(len(items), None, object), np.full(len(items), None, object)
    for place, (_, item) in enumerate(items):
        extras[place], notes[place] = item.extras, item.notes
    return Batch(
        b"".join([item.record for _, item in items]),
        ends - lengths,
        ends,
        np.array([item.edit for _, item in items], np.int32),
        np.array([due for due, _ in items], np.uint64),
        extras if any(item.extras for _, item in items) else None,
        notes if any(item.notes for _, item in items) else None,
        np.array([item.changed for _, item in items], np.int32),
    )


def _with_replaced(batch: Batch, replaced: dict[int, _Item]) -> Batch:
    if not replaced:
        return batch
    rows = list(replaced)
    new = _of_items([(0, item) for item in replaced.values()])
    edit = batch.edit.copy()
    edit[rows] = new.edit
    return replace(
        with_records(batch, rows, [item.record for item in replaced.values()]),
        edit=edit,
        extras=_overlaid(batch.extras, new.extras, rows, len(batch)),
        notes=_overlaid(batch.notes, new.notes, rows, len(batch)),
        changed=_overlaid(batch.changed, new.changed, rows, len(batch), nothing=-1, kind=np.int32),
    )


def _with_notes(batch: Batch, noted: dict[int, tuple[Change, ...]]) -> Batch:
    if noted:
        notes = np.full(len(batch), None, object) if batch.notes is None else batch.notes
        for row, changes in noted.items():
            notes[row] = changes
        batch.notes = notes
    return batch


def _overlaid(old: Any, new: Any, rows: Any, count: int, *, nothing: Any = None, kind: Any = object) -> Any:
    if old is None and new is None:
        return None
    found = np.full(count, nothing, kind) if old is None else old.copy()
    found[rows] = nothing if new is None else new
    return found
