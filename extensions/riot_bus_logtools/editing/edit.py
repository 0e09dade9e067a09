"""Edits logs: reads blocks, selects and changes messages, sorts and writes them."""

from __future__ import annotations

from contextlib import ExitStack
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from riot_bus.log.engine.blocks import MESSAGE_HEAD, TIMES
from riot_bus.log.naming import parse_time
from riot_bus.log.rosbag2 import files_of
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.capabilities import PublishesAs
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_logtools.editing.batch import Batch, Sorter, gathered, renumbered, shifted, with_payloads
from riot_bus_logtools.editing.channel_table import ChannelTable
from riot_bus_logtools.editing.inputs import InputLog
from riot_bus_logtools.editing.output_set import OutputSet
from riot_bus_logtools.editing.piping import Piping
from riot_bus_logtools.editing.result import EditResult

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from riot_bus.log.engine.blocks import Block
    from riot_bus.types.model import Adapter
    from riot_bus_logtools.editing.channel_edit import ChannelEdit
    from riot_bus_logtools.editing.options import EditOptions


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


def edit(
    options: EditOptions,
    *,
    interceptors: Sequence[object] = (),
    progress: Callable[[int, int], None] | None = None,
) -> EditResult:
    """Edit logs.

    When this raises, nothing is written or left behind.

    Args:
        options: Inputs, changes and outputs.
        interceptors: Interceptors, which see each message after it was changed.
        progress: Function that is called repeatedly with the number of bytes read and of all bytes.

    Returns:
        What happened to the messages; damaged inputs are not an error.

    Raises:
        ConfigError: An option, or an input or output file, is not usable.
        EnvironmentFaultError: The disk is full or broken.
    """
    with ExitStack() as stack:
        return _Editor(options, interceptors, stack).run(progress or (lambda done, total: None))


class _Editor:
    def __init__(self, options: EditOptions, interceptors: Sequence[object], stack: ExitStack) -> None:
        self._options = options
        design = options.design()
        paths = [path for each in options.inputs for path in files_of(each)]
        self._inputs = [InputLog(number, path, salvage=options.salvage) for number, path in enumerate(paths)]
        for log in self._inputs:
            stack.callback(log.close)
        self._output = OutputSet(options, paths)
        stack.callback(self._output.discard)
        for log, first in [(each, each.first()) for each in self._inputs] if options.align else ():
            log.shift = 0 if first is None else self._origin - first
        self._low, self._high = self._window()
        self._table = ChannelTable(options, design, self._inputs, lambda: self._origin)
        self._piping = self._pipe(interceptors, stack)
        one_shift = len({edit.shift for edit in self._table.edits if edit.target is not None}) <= 1
        self._latched: LatchedMessages | None = None
        if options.latched and self._low > 0:
            self._latched = LatchedMessages(self._low, self._table.edits, self._table.adapters)
        steps = (self._piping, self._latched)
        self._by_time = options.sort or len(self._inputs) > 1 or steps != (None, None) or not one_shift
        self._reorder = Sorter() if not one_shift else None
        self._sliced = self._low > -TIMES or self._high < TIMES

    def run(self, progress: Callable[[int, int], None]) -> EditResult:
        """Run the edit."""
        self._output.open(self._inputs, self._table)
        total, done = sum(log.size for log in self._inputs), 0
        rank = 0
        for block, bound, batch in self._batches():
            if self._latched is not None:
                batch = self._latched.run(batch)
                batch = gathered([self._latched.rest(), batch]) if bound is None else batch
            self._emit(self._processed(batch, bound), bound, rank)
            rank += 1
            done += block.body.length
            progress(done, total)
        if self._piping is not None:
            self._emit(self._piping.rest(), None, rank)
        if self._reorder is not None:
            self._write(self._reorder.ready(None))
        self._count_unread()
        warnings = self._warnings()
        files = self._output.commit(self._inputs, self._table)
        progress(total, total)
        return EditResult(
            self._table.counts(),
            files,
            {log.path: str(log.loss) for log in self._inputs if log.loss},
            dict(self._output.unwritable),
            warnings,
            next((log.loss.hint for log in self._inputs if log.loss.hint), None),
        )

    @cached_property
    def _origin(self) -> int:
        return min((first for log in self._inputs if (first := log.first()) is not None), default=0)

    def _window(self) -> tuple[int, int]:
        options = self._options
        low, high = -TIMES, TIMES
        if options.start is not None:
            low = parse_time(options.start, self._origin, where="--start")
        if options.end is not None:
            high = parse_time(options.end, self._origin, where="--end")
        elif options.duration is not None:
            high = (self._origin if options.start is None else low) + round(options.duration * 1e9)
        if high <= low:
            raise ConfigError(f"{options.end} is not after {options.start}", where="--end")
        return low, high

    def _pipe(self, interceptors: Sequence[object], stack: ExitStack) -> Piping | None:
        if not interceptors:
            return None
        pipeline = Pipeline(interceptors, registry=self._table.registry, start=self._origin)
        stack.callback(pipeline.close)
        pipeline.start()
        self._table.pipe(lambda key: bool(pipeline.route(key).stages))
        self._pipeline = pipeline
        return Piping(pipeline, self._table, self._output.refuse)

    def _batches(self) -> Iterator[tuple[Block, int | None, Batch]]:
        """Yield blocks and the messages that are due after each: its own, or those that no later block can precede."""
        if not self._by_time:
            (log,) = self._inputs
            for block in log.stored_blocks:
                if self._is_wanted(log, block):
                    yield block, None, self._in_window(log, log.batch(block, self._table.edit_of))
            return
        blocks = [(log, block) for log in self._inputs for block in log.stored_blocks if self._is_wanted(log, block)]
        blocks.sort(key=lambda each: (each[1].start + each[0].shift, each[0].number, each[1].number))
        sorter = Sorter()
        for place, (log, block) in enumerate(blocks):
            sorter.add((log.number, block.number), self._in_window(log, log.batch(block, self._table.edit_of)))
            following = blocks[place + 1] if place + 1 < len(blocks) else None
            bound = None if following is None else following[1].start + following[0].shift
            yield block, bound, sorter.ready(bound)

    def _is_wanted(self, log: InputLog, block: Block) -> bool:
        if not self._sliced or log.counts is None:
            return True  # everything is read if the summary does not tell how much is left out
        if block.start + log.shift >= self._high:
            return False
        return self._latched is not None or block.end + log.shift >= self._low

    def _in_window(self, log: InputLog, batch: Batch) -> Batch:
        if not self._sliced or log.counts is None:  # else they are counted from the summary, as not all are read
            self._count(batch, "read")
        if self._sliced:
            mask = batch.time >= np.uint64(max(self._low, 0)) if self._latched is None else self._latched.wanted(batch)
            if self._high < TIMES:
                mask &= batch.time < np.uint64(max(self._high, 0))
            batch = batch.where(mask)
        return batch

    def _processed(self, batch: Batch, bound: int | None) -> Batch:
        """Select and change messages, and count those that are kept."""
        edits = self._table.edits
        batch = batch.where(np.array([each.target is not None for each in edits], np.bool_)[batch.edit])
        looked_at = np.array([each.choosy for each in edits], np.bool_)[batch.edit]
        if looked_at.any():
            batch = self._looked_at(batch, np.flatnonzero(looked_at).tolist())
        self._count(batch, "kept")
        return batch if self._piping is None else self._piping.run(batch, bound)

    def _looked_at(self, batch: Batch, rows: list[int]) -> Batch:
        """Select and change messages one by one: in place if they keep their length, otherwise behind the others."""
        edits = self._table.edits
        changes = any(edits[number].changes for number in np.unique(batch.edit[rows]).tolist())
        buffer = batch.writable() if changes else batch.buffer
        kept = np.ones(len(batch), np.bool_)
        changed: list[int] = []
        longer: dict[int, bytes] = {}
        numbers, times = batch.edit.tolist(), batch.time.tolist()
        starts, ends = (batch.start + MESSAGE_HEAD).tolist(), batch.end.tolist()
        for row in rows:
            edit = edits[numbers[row]]
            count = edit.numbers[0]
            edit.numbers[0] = count + 1
            start, end = starts[row], ends[row]
            before = bytes(buffer[start:end])
            if edit.chooses and not edit.chosen(times[row], count, before):
                kept[row] = False
                continue
            after = edit.changed(times[row], count, before)
            if after is before or after == before:
                continue
            changed.append(row)
            if len(after) == len(before):
                assert isinstance(buffer, bytearray)
                buffer[start:end] = after
            else:
                longer[row] = after
        if changed:
            batch.changed = np.full(len(batch), -1, np.int32)
            batch.changed[changed] = batch.edit[changed]
        return with_payloads(batch, longer).where(kept)

    def _emit(self, batch: Batch, bound: int | None, rank: int) -> None:
        batch = self._addressed(batch)
        if self._reorder is None:
            self._write(batch)
            return
        self._reorder.add((rank, 0), batch)
        if bound is not None:
            least = min(edit.shift for edit in self._table.edits if edit.target is not None)
            self._write(self._reorder.ready(bound + least))

    def _addressed(self, batch: Batch) -> Batch:
        """Give records the times and channels of the output."""
        edits = self._table.edits
        shift = np.array([edit.shift for edit in edits], np.int64)
        if shift.any():
            batch, fits = shifted(batch, shift[batch.edit])
            if not fits.all():
                for number in batch.edit[~fits].tolist():
                    edits[number].counts.kept -= 1
                    self._output.refuse(edits[number].topic.name)
                batch = batch.take(fits)
        new = np.array([-1 if each.target is None else each.target.channel.id for each in edits], np.int64)
        old = np.array([edit.channel for edit in edits], np.int64)
        rows = np.flatnonzero((new != old)[batch.edit])
        renumbered(batch, rows, new[batch.edit[rows]].astype(np.uint16))
        return batch

    def _write(self, batch: Batch) -> None:
        if not len(batch):
            return
        self._count_written(batch)
        ready = None
        if batch.whole is not None:
            number, block = batch.whole
            ready = partial(self._inputs[number].packed, block, self._table.targets())
        self._output.write(batch, self._table.target_list(), ready)

    def _count(self, batch: Batch, name: str) -> None:
        edits = self._table.edits
        for number, count in enumerate(np.bincount(batch.edit, minlength=len(edits)).tolist()):
            edit = edits[number]
            if count and not edit.original:
                setattr(edit.counts, name, getattr(edit.counts, name) + count)

    def _count_written(self, batch: Batch) -> None:
        edits = self._table.edits
        if batch.changed is not None:
            for number in batch.changed[batch.changed >= 0].tolist():
                edits[number].counts.changed += 1
        for number, count in enumerate(np.bincount(batch.edit, minlength=len(edits)).tolist()):
            if edits[number].original:
                edits[number].counts.originals += count

    def _count_unread(self) -> None:
        """Count what was skipped because of its time, and what was read but not kept."""
        for log in self._inputs:
            for number, count in (log.counts or {}).items() if self._sliced else ():
                if number in log.channel_records:
                    edit = self._table.edits[self._table.edit_of(log, number)]
                    edit.counts.read += 0 if edit.original else count
        for counts in self._table.counts():
            counts.dropped = counts.read - counts.kept

    def _warnings(self) -> list[str]:
        found = [warning for step in self._table.steps for warning in step.warnings()]
        found += self._output.warnings(self._table)
        counts = self._table.counts()
        if any(each.read for each in counts) and not any(each.kept for each in counts):
            found.append("no message is kept")
        if self._piping is not None:
            for name, errors in self._pipeline.errors.items():
                text = f"interceptor {name} raised {errors.count} times; the messages went on without it. First:"
                found.append(f"{text}\n{errors.first}")
            if not any(counts.seen for counts in self._pipeline.counts.values()):
                found.append("no interceptor saw a message")
        return found
