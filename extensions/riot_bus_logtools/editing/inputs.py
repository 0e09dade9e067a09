"""Reads a log that is edited as batches of records, and copies its other records."""

from __future__ import annotations

import os
from collections import defaultdict
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Schema

from riot_bus.log import layout
from riot_bus.log.engine.blocks import HEAD, NUMBERS, Records, heads_of, read_packed
from riot_bus.log.engine.scan import parse
from riot_bus.log.reader import LogReader
from riot_bus_logtools.editing.batch import Batch, gathered, shifted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from riot_bus.log.engine.blocks import Block, Span
    from riot_bus.log.layout import Role
    from riot_bus.types.capabilities import RecordedTopic
    from riot_bus_logtools.editing.channel_edit import OutputChannel


class InputLog(LogReader):
    """Reads a log as batches of records, `shift` nanoseconds later; raises ConfigError as its base does."""

    def __init__(self, number: int, path: Path, *, salvage: bool = False) -> None:
        super().__init__(path, salvage=salvage)
        self.number = number
        self.shift = 0
        self._edits = np.full(NUMBERS, -1, np.int32)
        self._asked = np.zeros(NUMBERS, np.bool_)
        self._spans = self._provenance_spans()
        self._definitions: tuple[int, list[tuple[int, bytes]] | None] = -1, None

    @property
    def stored_blocks(self) -> list[Block]:
        """Its blocks in the order of the file."""
        return self._scan.blocks

    @property
    def channel_records(self) -> Mapping[int, Channel]:
        """Its channels by number."""
        return self._channels

    def schema(self, channel: Channel) -> Schema | None:
        """Return the schema of a channel."""
        return self._scan.schemas.get(channel.schema_id)

    def recorded_topic(self, number: int) -> RecordedTopic:
        """Return all that the file tells about a channel, by its number."""
        channel = self._channels[number]
        return self._source(number, channel).recorded(channel.metadata)

    @property
    def counts(self) -> Mapping[int, int] | None:
        """Number of messages of each channel, from the summary; None if that does not tell."""
        statistics = self._scan.statistics
        if statistics is None or not self._scan.finished or self._scan.unread or self._scan.missing_chunks:
            return None
        counts = statistics.channel_message_counts
        return counts if sum(counts.values()) == statistics.message_count else None

    @property
    def compression(self) -> str | None:
        """Compression of its chunks, `none` if none is compressed; None if it is unknown or there are no chunks."""
        found: str | None = None
        for block in islice((block for block in self._scan.blocks if block.chunked), 1000):
            head = read_packed(self._file, block, 64)  # it begins with 40 bytes and the name
            found = None if head is None else head[0]
            if found != "none":
                break
        return found

    def first(self) -> int | None:
        """Return the time of the first delivered message (of any, if there are no others), None if it is empty."""
        found = next(self.messages(), None) or next(self.originals(), None)
        return None if found is None else found.time + self.shift

    def batch(self, block: Block, edit_of: Callable[[InputLog, int], int]) -> Batch:
        """Return the messages of a block in the order of the file."""
        records = self._load_or_salvage(block)
        if records is None:
            return gathered([])
        definitions = list(records.definitions())
        self._definitions = block.number, definitions if len(definitions) == len(records.others) else None
        self.define(records)
        data, start = records.data, records.messages
        if not len(start):
            return gathered([])
        heads = heads_of(data, start)
        edit = self._edit_numbers(heads["channel"], edit_of)
        is_whole = block.chunked and not block.cut and records.numbers is None and not self.shift
        batch = Batch(
            data,
            start,
            start + heads["length"].astype(np.int64) + HEAD.size,
            edit,
            heads["time"].astype(np.uint64),
            self._extras(block, records),
            whole=(self.number, block) if is_whole else None,
        )
        if block.number in self._spans:
            batch.notes = self._notes(block, batch, heads)
        known = edit >= 0
        self.lost.unknown[block.number] = int((~known).sum())
        batch = batch.where(known)
        if self.shift:
            batch, fits = shifted(batch, np.full(len(batch), self.shift, np.int64))
            batch = batch.where(fits)
        return batch

    def packed(self, block: Block, targets: Sequence[OutputChannel]) -> tuple[str, bytes] | None:
        """Return the compression and data of the chunk loaded last; None if it cannot be copied unchanged.

        Then the channels that it defines must be those of the output.
        """
        return read_packed(self._file, block) if self._agrees(block, targets) else None

    def _agrees(self, block: Block, targets: Sequence[OutputChannel]) -> bool:
        number, definitions = self._definitions
        if number != block.number or definitions is None:
            return False
        channels = {each.channel.id: each.channel for each in targets}
        schemas = {each.schema.id: each.schema for each in targets if each.schema is not None}
        for opcode, body in definitions:
            is_schema = opcode == Opcode.SCHEMA
            record = parse(Schema, body) if is_schema else parse(Channel, body)
            if record is None or (schemas if is_schema else channels).get(record.id) != record:
                return False
        return True

    def attachments(self) -> Iterator[Attachment]:
        """Yield the attachments of other tools."""
        for span in self._scan.attachments:
            found = None
            if span.length <= self.limits.chunk:
                found = parse(Attachment, os.pread(self._file, span.length, span.offset))
            if found is None:
                self.lost.note_detail(span)
            else:
                yield found

    def _edit_numbers(self, channels: NDArray[Any], edit_of: Callable[[InputLog, int], int]) -> NDArray[np.int32]:
        for number in np.unique(channels[~self._asked[channels]]).tolist():
            if number in self._channels:
                self._edits[number] = edit_of(self, number)
                self._asked[number] = True
        found: NDArray[np.int32] = self._edits[channels]
        return found

    def _extras(self, block: Block, records: Records) -> NDArray[Any] | None:
        extras = records.renumbered(self.extras_of(block, records.most_written))
        if not extras:
            return None
        count = len(records.messages)
        found = np.full(count, None, object)
        for index, mapping in extras.items():
            if 0 <= index < count:
                found[index] = mapping
        return found

    def _provenance_spans(self) -> dict[int, list[Span]]:
        """Return the provenance records of each block, which are right before it."""
        found: dict[int, list[Span]] = defaultdict(list)
        blocks = iter(self._scan.blocks)
        block = next(blocks, None)
        for name, span in self._scan.metadata:
            if name == layout.PROVENANCE:
                while block is not None and block.body.offset < span.offset:
                    block = next(blocks, None)
                if block is not None:
                    found[block.number].append(span)
        return dict(found)

    def _notes(self, block: Block, batch: Batch, heads: NDArray[Any]) -> NDArray[Any] | None:
        notes: dict[tuple[Role, str, int, int], list[Any]] = defaultdict(list)
        for span in self._spans[block.number]:
            for entry in self._provenance_at(span):
                notes[entry.role, entry.key, entry.sequence & 0xFFFFFFFF, entry.time].append(entry.changes)
        found = np.full(len(batch), None, object)
        present = {n: self._channels.get(n) for n in np.unique(heads["channel"]).tolist()}
        sources = {n: self._source(n, channel) for n, channel in present.items() if channel is not None}
        wanted = zip(heads["channel"].tolist(), heads["sequence"].tolist(), heads["time"].tolist(), strict=True)
        for row, (number, sequence, time) in enumerate(wanted):
            if number in sources:
                changes = notes.get((sources[number].role, sources[number].key, sequence, time))
                if changes:
                    found[row] = changes.pop(0)
        return found
