"""A log that is edited: its blocks as batches, and its losses."""

from __future__ import annotations

import os
import weakref
from collections import defaultdict
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Schema

from riot_bus.log import layout
from riot_bus.log.editing.batch import MESSAGE_HEAD, Batch, heads_of, shifted
from riot_bus.log.engine.blocks import HEAD, Records, read_block, records_of
from riot_bus.log.engine.salvage import Salvage, salvage
from riot_bus.log.engine.scan import define, learn_block, parse, read_metadata, scan_file
from riot_bus.log.limits import lifted
from riot_bus.log.loss import LossNotes
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from riot_bus.log.editing.targets import OutputChannel
    from riot_bus.log.engine.scan import Block, Span
    from riot_bus.log.layout import Role
    from riot_bus.log.loss import Loss

__all__ = ["InputLog"]

_CHANNELS = 1 << 16  # MCAP's channel numbers have 16 bits
_CHUNK_NAME_AT = 28  # in MCAP's chunk record, after two times, size and CRC (8 + 8 + 8 + 4)
_MOST_LOOKED_AT = 1000  # uncompressed chunks before a compressed one; looking at each reads 64 bytes


class InputLog:
    """A log that is open, and is closed when it is no longer used; damage never raises an exception.

    Args:
        number: Position among the inputs.
        path: Path of the file.
        salvage: Whether to take messages of damaged chunks that an index confirms.

    Attributes:
        shift: Nanoseconds that are added to all its times.

    Raises:
        ConfigError: The file is missing or not an MCAP file.
    """

    def __init__(self, number: int, path: Path, *, salvage: bool = False) -> None:
        self.number = number
        self.path = path
        self.shift = 0
        try:
            self._file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            raise ConfigError(f"cannot read the log: {reason}", where=str(path)) from error
        self.close = weakref.finalize(self, os.close, self._file)
        self._salvage = salvage
        self._limits = lifted()
        self._lost = LossNotes()
        try:
            self._scan = scan_file(self._file, str(path), self._limits)
            self._learn()
        except BaseException:
            self.close()
            raise
        self._courses = np.full(_CHANNELS, -1, np.int32)
        self._asked = np.zeros(_CHANNELS, np.bool_)
        self._spans = self._provenance_spans()
        self._others: tuple[int, list[tuple[int, bytes]]] = -1, []

    @property
    def size(self) -> int:
        """Bytes of the file."""
        return self._scan.size

    @property
    def profile(self) -> str:
        """The file's MCAP profile, such as `ros2`."""
        return self._scan.header.profile if self._scan.header else ""

    @property
    def blocks(self) -> list[Block]:
        """Its blocks in the order of the file."""
        return self._scan.blocks

    @property
    def channels(self) -> Mapping[int, Channel]:
        """Its channels by number."""
        return self._scan.channels

    def schema(self, channel: Channel) -> Schema | None:
        """Return the schema of a channel."""
        return self._scan.schemas.get(channel.schema_id)

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
        for block in islice((block for block in self._scan.blocks if block.chunked), _MOST_LOOKED_AT):
            head = os.pread(self._file, 64, block.body.offset)
            length = int.from_bytes(head[_CHUNK_NAME_AT : _CHUNK_NAME_AT + 4], "little")
            name = head[_CHUNK_NAME_AT + 4 :][:length]
            found = {b"": "none", b"lz4": "lz4", b"zstd": "zstd"}.get(name)
            if found != "none":
                break
        return found

    @property
    def loss(self) -> Loss:
        """What could not be read so far."""
        return self._lost.total(self._scan)

    def first(self) -> int | None:
        """Return the time of the first delivered message (of any, if there are no others), None if it is empty."""
        low: int | None = None
        lowest: int | None = None
        originals = [n for n, each in self._scan.channels.items() if each.metadata.get(layout.ROLE) == "original"]
        for block in sorted(self._scan.blocks, key=lambda block: block.start):
            if low is not None and block.start >= low:
                break
            try:
                data, records, _ = self._read(block)
            except ValueError:
                continue
            heads = heads_of(data, records.messages)
            delivered = heads["time"][~np.isin(heads["channel"], originals)]
            for times, is_delivered in ((heads["time"], False), (delivered, True)):
                if len(times):
                    least = int(times.min())
                    lowest = least if lowest is None else min(least, lowest)
                    if is_delivered:
                        low = least if low is None else min(least, low)
        found = lowest if low is None else low
        return None if found is None else found + self.shift

    def load(self, block: Block, course_of: Callable[[InputLog, int], int]) -> Batch | None:
        """Return the messages of a block in the order of the file; None if there are none.

        Args:
            block: One of the `blocks`.
            course_of: Function that returns the number of a channel's course.
        """
        try:
            data, records, saved = self._read(block)
        except ValueError:
            return None
        self._others = block.number, [(opcode, data[begin:end]) for opcode, begin, end in records.others]
        for opcode, body in self._others[1]:
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                define(self._scan, opcode, body)
        start = records.messages
        if not len(start):
            return None
        heads = heads_of(data, start)
        course = self._course_numbers(heads["channel"], course_of)
        end = start + heads["length"].astype(np.int64) + HEAD.size
        batch = Batch(
            data,
            start,
            end,
            course,
            heads["time"].astype(np.uint64),
            self._extras(block, len(start), len(data)) if saved is None else self._extras_of_rest(block, saved),
            whole=(self, block) if block.chunked and not block.cut and saved is None and not self.shift else None,
        )
        if block.number in self._spans:
            batch.notes = self._notes(block, batch, heads)
        known = course >= 0
        if not known.all():
            self._lost.unknown[block.number] = int((~known).sum())
            batch = batch.take(known)
        if self.shift:
            batch, fits = shifted(batch, np.full(len(batch), self.shift, np.int64))
            batch = batch.where(fits)
        return batch

    def agrees(self, block: Block, targets: Sequence[OutputChannel]) -> bool:
        """Return whether the definitions in the block that was loaded last are those of an output.

        Args:
            block: Block that was loaded last.
            targets: All channels of the output.
        """
        number, others = self._others
        if number != block.number:
            return False
        channels = {each.channel.id: each.channel for each in targets}
        schemas = {each.schema.id: each.schema for each in targets if each.schema is not None}
        for opcode, body in others:
            if opcode == Opcode.SCHEMA:
                schema = parse(Schema, body)
                if schema is None or schemas.get(schema.id) != schema:
                    return False
            elif opcode == Opcode.CHANNEL:
                channel = parse(Channel, body)
                if channel is None or channels.get(channel.id) != channel:
                    return False
            else:
                return False
        return True

    def packed(self, block: Block) -> tuple[str, bytes] | None:
        """Return the compression of a chunk and its compressed data; None if the compression is unknown."""
        body = os.pread(self._file, block.body.length, block.body.offset)
        length = int.from_bytes(body[_CHUNK_NAME_AT : _CHUNK_NAME_AT + 4], "little")
        begin = _CHUNK_NAME_AT + 4 + length
        name = {b"": "none", b"lz4": "lz4", b"zstd": "zstd"}.get(body[_CHUNK_NAME_AT + 4 : begin])
        size = int.from_bytes(body[begin : begin + 8], "little")
        return None if name is None else (name, body[begin + 8 : begin + 8 + size])

    def metadata(self) -> Iterator[tuple[str, dict[str, str]]]:
        """Yield the metadata records unchanged, except for provenance."""
        for name, span in self._scan.metadata:
            if name != layout.PROVENANCE:
                mapping = read_metadata(self._file, span, self._limits)
                if mapping is None:
                    self._lost.note_detail(span)
                else:
                    yield name, mapping

    def attachments(self) -> Iterator[Attachment]:
        """Yield the attachments of other tools."""
        for span in self._scan.attachments:
            found = None
            if span.length <= self._limits.chunk:
                found = parse(Attachment, os.pread(self._file, span.length, span.offset))
            if found is None:
                self._lost.note_detail(span)
            else:
                yield found

    def _learn(self) -> None:
        scan = self._scan
        expected = scan.statistics.channel_count if scan.statistics else None
        if scan.finished and expected == len(scan.channels):
            return
        for block in scan.blocks:
            try:
                learn_block(self._file, block, scan)
            except ValueError as error:
                self._lost.note_damage(block, error)
                if self._salvage:
                    self._learn_rest(block)

    def _learn_rest(self, block: Block) -> None:
        saved = salvage(self._file, block, self._limits)
        if saved is None:
            return
        for opcode, begin, end in saved.records.others:
            define(self._scan, opcode, saved.data[begin:end])

    def _read(self, block: Block) -> tuple[bytes, Records, Salvage | None]:
        """Return a block's records, for a damaged one those that an index confirms; or raise ValueError."""
        try:
            data = read_block(self._file, block, self._limits)
            return data, records_of(data, self._limits, cut=block.cut), None
        except ValueError as error:
            self._lost.note_damage(block, error)
            saved = salvage(self._file, block, self._limits) if self._salvage else None
            if saved is None:
                raise
        self._lost.salvaged[block.number] = len(saved.places)
        return saved.data, saved.records, saved

    def _extras_of_rest(self, block: Block, saved: Salvage) -> NDArray[Any] | None:
        count = len(saved.places) + saved.missing
        found = self._extras(block, count, count * MESSAGE_HEAD)
        return None if found is None else found[saved.places]

    def _course_numbers(self, channels: NDArray[Any], course_of: Callable[[InputLog, int], int]) -> NDArray[np.int32]:
        for number in np.unique(channels[~self._asked[channels]]).tolist():
            if number in self._scan.channels:
                self._courses[number] = course_of(self, number)
                self._asked[number] = True
        found: NDArray[np.int32] = self._courses[channels]
        return found

    def _extras(self, block: Block, count: int, size: int) -> NDArray[Any] | None:
        try:
            extras = layout.load_extras(self._file, block, size // MESSAGE_HEAD, self._limits)
        except (ValueError, OSError) as error:
            self._lost.note_detail(block, error)
            return None
        if not extras:
            return None
        found = np.full(count, None, object)
        for place, mapping in extras.items():
            if 0 <= place < count:
                found[place] = mapping
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
            try:
                entries = layout.unpack_provenance(
                    (read_metadata(self._file, span, self._limits) or {}).get("changes", "")
                )
            except ValueError:
                self._lost.note_detail(span)
                continue
            for entry in entries:
                notes[entry.role, entry.key, entry.sequence & 0xFFFFFFFF, entry.time].append(entry.changes)
        found = np.full(len(batch), None, object)
        names: dict[int, tuple[Role, str]] = {}
        for number in np.unique(heads["channel"]).tolist():
            channel = self._scan.channels.get(number)
            if channel is not None:
                original = channel.metadata.get(layout.ROLE) == "original"
                names[number] = "original" if original else "delivered", channel.metadata.get(layout.KEY, channel.topic)
        wanted = zip(heads["channel"].tolist(), heads["sequence"].tolist(), heads["time"].tolist(), strict=True)
        for row, (number, sequence, time) in enumerate(wanted):
            if number in names:
                waiting = notes.get((*names[number], sequence, time))
                if waiting:
                    found[row] = waiting.pop(0)
        return found
