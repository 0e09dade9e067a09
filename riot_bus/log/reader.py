"""Reads logs in bounded memory, whole or damaged, written by riot_bus or as a ROS 2 bag."""

from __future__ import annotations

import os
import weakref
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any, Self

from mcap.records import Channel
from mcap.records import Schema as SchemaRecord

from riot_bus.given_files import given_file
from riot_bus.log import layout
from riot_bus.log.engine.blocks import MESSAGE_HEAD, Block, Records, Span, claimed_size, read_block, records_of
from riot_bus.log.engine.limits import LogLimits
from riot_bus.log.engine.salvage import salvage
from riot_bus.log.engine.scan import MessageEntry, Scan, define, load_block, read_attachment, read_metadata, scan_file
from riot_bus.log.engine.sorting import OverlapSorter
from riot_bus.log.layout import Constants, Provenance, Role
from riot_bus.log.limits import lifted
from riot_bus.log.loss import Loss, LossNotes
from riot_bus.types.capabilities import RecordedTopic
from riot_bus.types.model import Schema
from riot_bus.types.serve import Request
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.selector import key_matches


@dataclass(frozen=True, slots=True)
class ChannelSource:
    """The common properties of the messages of a channel; `own` tells whether riot_bus has written them."""

    key: str
    topic: str
    role: Role
    own: bool
    constants: Constants
    schema: Schema
    encoding: str

    @property
    def payload_encoding(self) -> str:
        """Encoding of the payloads as on the bus, otherwise MCAP's."""
        return self.constants.encoding or self.encoding

    def recorded(self, details: Mapping[str, str]) -> RecordedTopic:
        """Return all that the file tells about the channel, with its metadata as details."""
        return RecordedTopic(self.topic, self.key, self.own, self.schema, self.encoding, dict(details))

    def chosen(self, topics: Sequence[str] | None) -> bool:
        """Return whether one of these topic names and key expressions includes it; None includes all."""
        return topics is None or self._is_among(*_choice(tuple(topics)))

    def _is_among(self, exact: frozenset[str], patterns: tuple[str, ...]) -> bool:
        name = self.topic.strip("/")
        return not exact.isdisjoint((self.topic, self.key, name)) or any(
            key_matches(text, self.key) or key_matches(text.strip("/"), name) for text in patterns
        )


@lru_cache(maxsize=64)
def _choice(topics: tuple[str, ...]) -> tuple[frozenset[str], tuple[str, ...]]:
    """Return the names, also without slashes at their ends, and the key expressions among them."""
    names = [text for text in topics if "*" not in text]
    exact = frozenset({*topics, *(text.strip("/") for text in names)})
    return exact, tuple(text for text in topics if "*" in text)


class LogReader:
    """Reads an MCAP file; a context manager.

    Damage is never an exception: everything readable is read, and `loss` says what is missing (as far as the file has
    been read).

    Args:
        path: Path of the file.
        salvage: Whether to take messages of damaged chunks that an index confirms (`riot_bus.log.engine.salvage`).
        limits: Limits of what is read; None for the default ones, with the changes in `RIOT_LOG_LIMITS`.

    Raises:
        ConfigError: The file is missing or not an MCAP file.
    """

    def __init__(self, path: Path | str, *, salvage: bool = False, limits: LogLimits | None = None) -> None:
        self.path = str(path)
        self.limits = lifted() if limits is None else limits
        self._salvage = salvage
        self._file = open_log(path)
        self.close = weakref.finalize(self, os.close, self._file)
        """Close the file; done automatically when the reader is no longer used."""
        try:
            self._scan: Scan = scan_file(self._file, self.path, self.limits)
        except BaseException:
            self.close()
            raise
        self._sources: dict[int, ChannelSource] = {}
        self.lost = LossNotes()
        self._loaded_bytes = 0

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
    def library(self) -> str:
        """The library that has written the file, as the file states."""
        return self._scan.header.library if self._scan.header else ""

    @property
    def loss(self) -> Loss:
        """What could not be read so far."""
        return self.lost.total(self._scan)

    @cached_property
    def metadata(self) -> Mapping[str, str]:
        """The `metadata` that was passed to the writer."""
        spans = [span for name, span in self._scan.metadata if name == layout.RUN]
        return {key: text for span in spans for key, text in (self._read_metadata(span) or {}).items()}

    @property
    def schemas(self) -> Mapping[str, tuple[Schema, str]]:
        """By topic: the type's definition (empty if there is none) and the message encoding."""
        found: dict[str, tuple[Schema, str]] = {}
        for source in self.sources().values():
            found.setdefault(source.topic, (source.schema, source.encoding))
        return found

    def sources(self) -> Mapping[int, ChannelSource]:
        """Return the properties of each channel's messages, by the channel's number in the file."""
        return {number: self._source(number, channel) for number, channel in self._channels.items()}

    def recorded_topics(self) -> list[RecordedTopic]:
        """Return the topics of the delivered messages; if a topic has several channels, the first one counts."""
        found: dict[str, RecordedTopic] = {}
        for number, source in self.sources().items():
            if source.role == "delivered":
                found.setdefault(source.key, source.recorded(self._channels[number].metadata))
        return list(found.values())

    @property
    def latest(self) -> int:
        """Time of the last message as chunks state it, without reading them; 0 for an empty log."""
        return max((block.end for block in self._scan.blocks), default=0)

    def span(self) -> tuple[int, int] | None:
        """Return the times of the first and (roughly) the last message, without reading all; None for an empty log."""
        first = next((message.time for message in self.messages()), None)
        return None if first is None else (first, max(first, self.latest))

    def messages(
        self,
        *,
        topics: Sequence[str] | None = None,
        role: Role = "delivered",
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[Message]:
        """Yield messages sorted by time of reception, those of equal time in the file's order.

        Args:
            topics: Topic names or key expressions; None for all.
            role: The messages that were delivered, or the originals of those that interceptors touched.
            start: Earliest time, nanoseconds.
            end: Latest time (exclusive), nanoseconds.
        """
        choice = None if topics is None else _choice(tuple(topics))  # once: there may be 60,000 topics and channels
        wanted = {
            number: source
            for number, source in self.sources().items()
            if source.role == role and (choice is None or source._is_among(*choice))
        }
        if not wanted and (topics is not None or role != "delivered"):
            return
        low, high = start or 0, 1 << 64 if end is None else end
        for entry in self._entries(low, high):
            found = wanted.get(entry.channel)
            if found is not None and low <= entry.time < high:
                yield message_of(entry, found)

    def originals(self) -> Iterator[Message]:
        """Yield the originals of messages that were changed, delayed or dropped."""
        return self.messages(role="original")

    def provenance(self) -> Iterator[Provenance]:
        """Yield what interceptors did, in the order of writing."""
        for name, span in self._scan.metadata:
            if name == layout.PROVENANCE:
                yield from self._provenance_at(span)

    def notes(self, name: str) -> Iterator[Mapping[str, str]]:
        """Yield what was written with `LogWriter.note`, in the order of writing; damaged ones are left out."""
        return (mapping for found, mapping in self.metadata_records() if found == name)

    def metadata_records(self) -> Iterator[tuple[str, Mapping[str, str]]]:
        """Yield name and mapping of the metadata records except provenance; damaged ones are counted and left out."""
        for name, span in self._scan.metadata:
            mapping = None if name == layout.PROVENANCE else self._read_metadata(span)
            if mapping is not None:
                yield name, mapping
            elif name != layout.PROVENANCE:
                self.lost.note_detail(span)

    def blocks(self, low: int = 0, high: int = 1 << 64) -> list[Block]:
        """Return the blocks that may have messages in [low, high), sorted by time, then by order in the file."""
        return sorted(
            (block for block in self._scan.blocks if block.end >= low and block.start < high),
            key=lambda block: (block.start, block.number),
        )

    def load(self, block: Block, *, memory: int | None = None) -> Records:
        """Return the records of one of the `blocks`; counts nothing, so threads may load blocks ahead.

        Args:
            block: The block.
            memory: Most bytes, before and after decompression, if the limits allow more.

        Raises:
            ValueError: The block is damaged, or beyond the limits; to be passed to `salvage`.
        """
        data = read_block(self._file, block, self.limits, memory=memory)
        return records_of(data, self.limits, cut=block.cut)

    def salvage(self, block: Block, problem: ValueError, *, memory: int | None = None) -> Records | None:
        """Count a block as damaged, and return what an index confirms of it; None if nothing, or if not to be used."""
        self.lost.note_damage(block, problem)
        found = salvage(self._file, block, self.limits, memory=memory) if self._salvage else None
        if found is not None:
            self.lost.salvaged[block.number] = len(found.messages)
        return found

    def claimed_size(self, block: Block) -> int:
        """Return how many bytes a block claims to have once it is decompressed, 0 if it cannot be read."""
        return claimed_size(self._file, block)

    def define(self, records: Records) -> None:
        """Add the schemas and channels among the records of a block."""
        for opcode, body in records.definitions():
            define(self._scan, opcode, body)

    def extras_of(self, block: Block, most: int) -> dict[int, dict[str, Any]]:
        """Return a block's extras by the message's position in the block; damaged ones are counted and left out.

        At most so many messages, `Records.most_written`, can be in the block.
        """
        try:
            if block.extras is None:
                return {}
            return layout.unpack_extras(read_attachment(self._file, block.extras, self.limits), most, self.limits)
        except (ValueError, OSError) as error:
            self.lost.note_detail(block, error)
            return {}

    def salvageable(self) -> int:
        """Return how many messages an index confirms in the chunks that were found to be damaged."""
        blocks = [block for block in self._scan.blocks if block.number in self.lost.damaged]
        found = (salvage(self._file, block, self.limits) for block in blocks)
        return sum(len(each.messages) for each in found if each is not None)

    def _read_metadata(self, span: Span) -> dict[str, str] | None:
        return read_metadata(self._file, span, self.limits)

    def _provenance_at(self, span: Span) -> list[Provenance]:
        """Return the provenance in a metadata record; none if that is damaged, which is counted."""
        try:
            return layout.unpack_provenance((self._read_metadata(span) or {}).get("changes", ""))
        except ValueError:
            self.lost.note_detail(span)
            return []

    @cached_property
    def _channels(self) -> dict[int, Channel]:
        scan = self._scan
        expected = scan.statistics.channel_count if scan.statistics else None
        if not scan.finished or expected != len(scan.channels):
            for block in scan.blocks:
                found = self._load_or_salvage(block)
                if found is not None:
                    self.define(found)
        return scan.channels

    def _load_or_salvage(self, block: Block) -> Records | None:
        try:
            return self.load(block)
        except ValueError as error:
            return self.salvage(block, error)

    def _entries(self, low: int, high: int) -> Iterator[MessageEntry]:
        blocks = self.blocks(low, high)
        sorter, bound = OverlapSorter(), 0
        for place, block in enumerate(blocks):
            loaded = self._load(block)
            sorter.add(loaded, self._loaded_bytes)
            if loaded and loaded[0].time < bound:
                self.lost.unsorted[block.number] = bisect_left(loaded, bound, key=attrgetter("time"))
            del loaded
            if place + 1 < len(blocks):
                ready = sorter.release(blocks[place + 1].start)
                if sorter.held > self.limits.held:
                    ready += sorter.release()
                if ready:
                    bound = max(bound, ready[-1].time)
                    yield from ready
                del ready  # before the next block is loaded
        yield from sorter.release()

    def _load(self, block: Block) -> list[MessageEntry]:
        try:
            data = read_block(self._file, block, self.limits)
            self._loaded_bytes = len(data)
            entries = load_block(data, block, self._scan, self.extras_of(block, len(data) // MESSAGE_HEAD))
        except ValueError as error:
            entries = []
            if (found := self.salvage(block, error)) is not None:
                self._loaded_bytes = len(found.data)
                extras = found.renumbered(self.extras_of(block, found.most_written))
                entries = load_block(found.data, block, self._scan, extras)
        self.lost.unknown[block.number] = sum(entry.channel not in self._scan.channels for entry in entries)
        return entries

    def _source(self, number: int, channel: Channel) -> ChannelSource:
        source = self._sources.get(number)
        if source is None:
            source = self._sources[number] = channel_source(channel, self._scan.schemas.get(channel.schema_id))
        return source


def open_log(path: Path | str) -> int:
    """Return a descriptor of a file for reading; raises ConfigError if it cannot be opened, or is no file."""
    try:
        return os.open(given_file(Path(path)), os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except ValueError as error:
        raise ConfigError(f"cannot read the log: {error}", where=repr(str(path))) from error
    except OSError as error:
        raise ConfigError(f"cannot read the log: {error.strerror}", where=str(path)) from error


def channel_source(channel: Channel, schema: SchemaRecord | None) -> ChannelSource:
    """Return the properties of a channel's messages, from its records in the file."""
    metadata, topic = channel.metadata, channel.topic
    return ChannelSource(
        metadata.get(layout.KEY, topic),
        metadata.get(layout.TOPIC, topic),
        "original" if metadata.get(layout.ROLE) == "original" else "delivered",
        layout.KEY in metadata,
        Constants.from_metadata(metadata),
        Schema(schema.name, schema.encoding, schema.data) if schema else Schema("", "", b""),
        channel.message_encoding,
    )


def read_log(path: Path | str) -> tuple[Message, ...]:
    """Return all delivered messages of a log that fits into memory; damage at its end is passed over."""
    with LogReader(path) as reader:
        return tuple(reader.messages())


def message_of(entry: MessageEntry, source: ChannelSource) -> Message:
    """Return a message of a channel as it was on the bus."""
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
    return (Request if "parameters" in fields else Message)(entry.time, source.key, entry.payload, **fields)
