"""Read a log in bounded memory, whole or damaged, ours or a ROS 2 bag."""

from __future__ import annotations

import os
import weakref
from bisect import bisect_left
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

from riot_bus.errors import ConfigError
from riot_bus.log import layout
from riot_bus.log.layout import Constants, Provenance, Role
from riot_bus.log.scan import Block, Entry, Scan, load_block, load_extras, read_metadata, scan_file
from riot_bus.message import Message
from riot_bus.selector import key_matches
from riot_bus.types.model import Schema

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from mcap.records import Channel

__all__ = ["LogReader", "Loss", "read_log"]


@dataclass(frozen=True, slots=True)
class Loss:
    """What a reader could not read; false when nothing is missing.

    Attributes:
        unfinished: The file was never closed: what its writer had not yet written is lost.
        bytes: Bytes at the end that are not a whole record.
        chunks: Damaged chunks that were left out.
        messages: Messages that were left out because their channel is unknown.
        details: Damaged extras or provenance: messages lack attachments or notes, but not their payload.
    """

    unfinished: bool = False
    bytes: int = 0
    chunks: int = 0
    messages: int = 0
    details: int = 0

    def __bool__(self) -> bool:
        return self != Loss()

    def __str__(self) -> str:
        parts = [
            "the file was not closed" if self.unfinished else "",
            f"{self.bytes} bytes cut off at the end" if self.bytes else "",
            f"{self.chunks} damaged chunks" if self.chunks else "",
            f"{self.messages} messages of unknown channels" if self.messages else "",
            f"{self.details} damaged attachments or notes" if self.details else "",
        ]
        return ", ".join(part for part in parts if part) or "nothing lost"


@dataclass(frozen=True, slots=True)
class _Source:
    key: str
    topic: str
    role: Role
    own: bool
    constants: Constants


class LogReader:
    """Reads an MCAP file; a context manager.

    Damage is never an exception: everything readable is read, and `loss` says what is missing (as far as the file has
    been read).

    Args:
        path: The file.

    Raises:
        ConfigError: The file is missing or not an MCAP file.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = str(path)
        try:
            self._file = os.open(path, os.O_RDONLY)
        except OSError as error:
            raise ConfigError(f"cannot read the log: {error.strerror}", where=self.path) from error
        self.close = weakref.finalize(self, os.close, self._file)
        """Close the file; happens by itself when the reader is no longer used."""
        try:
            self._scan: Scan = scan_file(self._file, self.path)
        except IsADirectoryError:
            self.close()
            raise ConfigError("this is a directory", where=self.path, hint="name the .mcap file in it") from None
        except ConfigError:
            self.close()
            raise
        self._sources: dict[int, _Source] = {}
        self._damaged: dict[int, str] = {}
        self._details: set[int] = set()
        self._unknown: dict[int, int] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def size(self) -> int:
        """Size of the file in bytes."""
        return self._scan.size

    @property
    def profile(self) -> str:
        """The file's MCAP profile, such as `ros2`."""
        return self._scan.header.profile if self._scan.header else ""

    @property
    def loss(self) -> Loss:
        """What could not be read so far."""
        return Loss(
            unfinished=not self._scan.finished,
            bytes=self._scan.unread,
            chunks=len(self._damaged),
            messages=sum(self._unknown.values()),
            details=len(self._details),
        )

    @cached_property
    def metadata(self) -> Mapping[str, str]:
        """What the writer was given as `metadata`."""
        found: dict[str, str] = {}
        for name, span in self._scan.metadata:
            if name == layout.RUN:
                found |= read_metadata(self._file, span) or {}
        return found

    @property
    def schemas(self) -> Mapping[str, tuple[Schema, str]]:
        """By topic: the type's definition (empty if there is none) and the message encoding."""
        found: dict[str, tuple[Schema, str]] = {}
        for topic, _, schema, encoding in self.channels():
            found.setdefault(topic, (schema, encoding))
        return found

    def channels(self) -> Iterator[tuple[str, str, Schema, str]]:
        """Yield topic, key, schema and message encoding of every channel."""
        for number, channel in self._channels.items():
            record = self._scan.schemas.get(channel.schema_id)
            schema = Schema(record.name, record.encoding, record.data) if record else Schema("", "", b"")
            source = self._source(number, channel)
            yield source.topic, source.key, schema, channel.message_encoding

    def messages(
        self,
        *,
        topics: Sequence[str] | None = None,
        role: Role = "delivered",
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[Message]:
        """Yield messages by time of reception; those of equal time in the file's order.

        Args:
            topics: Topic names or key expressions; None for all.
            role: The messages that were delivered, or the originals of those that interceptors touched.
            start: Earliest time, nanoseconds.
            end: Latest time (exclusive), nanoseconds.
        """
        wanted = {
            number: source
            for number, channel in self._channels.items()
            if (source := self._source(number, channel)).role == role and _selected(source, topics)
        }
        if not wanted:
            return
        low, high = start or 0, 1 << 64 if end is None else end
        for entry in self._entries(low, high):
            found = wanted.get(entry.channel)
            if found is not None and low <= entry.time < high:
                yield _message(entry, found)

    def originals(
        self, *, topics: Sequence[str] | None = None, start: int | None = None, end: int | None = None
    ) -> Iterator[Message]:
        """Yield the originals of messages that were changed, delayed or dropped."""
        return self.messages(topics=topics, role="original", start=start, end=end)

    def provenance(self) -> Iterator[Provenance]:
        """Yield what interceptors did, in the order of writing."""
        for name, span in self._scan.metadata:
            if name != layout.PROVENANCE:
                continue
            try:
                entries = layout.unpack_provenance((read_metadata(self._file, span) or {}).get("changes", ""))
            except ValueError:
                self._details.add(-span.offset)  # apart from block numbers
            else:
                yield from entries

    def notes(self, name: str) -> Iterator[Mapping[str, str]]:
        """Yield what was written with `LogWriter.note`, in the order of writing; damaged ones are left out.

        Args:
            name: Such as `riot_bus.graph`.
        """
        for found, span in self._scan.metadata:
            if found == name:
                mapping = read_metadata(self._file, span)
                if mapping is None:
                    self._details.add(-span.offset)
                else:
                    yield mapping

    @cached_property
    def _channels(self) -> dict[int, Channel]:
        scan = self._scan
        expected = scan.statistics.channel_count if scan.statistics else None
        if not scan.finished or expected != len(scan.channels):
            for block in scan.blocks:
                self._load(block)
        return scan.channels

    def _entries(self, low: int, high: int) -> Iterator[Entry]:
        blocks = sorted(
            (block for block in self._scan.blocks if block.end >= low and block.start < high),
            key=lambda block: (block.start, block.number),
        )
        waiting: list[Entry] = []
        for place, block in enumerate(blocks):
            waiting += self._load(block)
            waiting.sort()
            if place + 1 < len(blocks):
                ready = bisect_left(waiting, blocks[place + 1].start, key=lambda entry: entry.time)
                yield from waiting[:ready]
                del waiting[:ready]
        yield from waiting

    def _load(self, block: Block) -> list[Entry]:
        try:
            extras = load_extras(self._file, block)
        except ValueError:
            self._details.add(block.number)
            extras = {}
        try:
            entries = load_block(self._file, block, self._scan, extras)
        except ValueError as error:
            self._damaged[block.number] = str(error)
            return []
        unknown = sum(entry.channel not in self._scan.channels for entry in entries)
        if unknown:
            self._unknown[block.number] = unknown
        return entries

    def _source(self, number: int, channel: Channel) -> _Source:
        source = self._sources.get(number)
        if source is not None:
            return source
        metadata, topic = channel.metadata, channel.topic
        role: Role = "original" if metadata.get(layout.ROLE) == "original" else "delivered"
        self._sources[number] = created = _Source(
            metadata.get(layout.KEY, topic),
            metadata.get(layout.TOPIC, topic),
            role,
            layout.KEY in metadata,
            Constants.from_metadata(metadata),
        )
        return created


def read_log(path: Path | str) -> tuple[Message, ...]:
    """Return all delivered messages of a log that fits into memory; damage at its end is passed over."""
    with LogReader(path) as reader:
        return tuple(reader.messages())


def _selected(source: _Source, topics: Sequence[str] | None) -> bool:
    if topics is None:
        return True
    name = source.topic.strip("/")
    return any(
        text in (source.topic, source.key) or key_matches(text, source.key) or key_matches(text.strip("/"), name)
        for text in topics
    )


def _message(entry: Entry, source: _Source) -> Message:
    constants = source.constants
    published = None if source.own and entry.published == entry.time else entry.published
    if entry.extras is None:
        return Message(
            entry.time,
            source.key,
            entry.payload,
            "put",
            constants.encoding,
            None,
            constants.qos,
            constants.segment,
            entry.sequence,
            published,
        )
    fields: dict[str, Any] = {
        "encoding": constants.encoding,
        "qos": constants.qos,
        "segment": constants.segment,
        "sequence": entry.sequence,
        "publish_time": published,
    }
    layout.apply_extras(fields, entry.extras)
    return Message(entry.time, source.key, entry.payload, **fields)
