"""Gives an overview of a log, from its summary or by reading all of it."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from riot_bus.log import layout
from riot_bus.log.account import LOST, Account, account_of
from riot_bus.log.engine.limits import LogLimits
from riot_bus.log.engine.scan import read_metadata
from riot_bus.log.engine.summary import Summary, read_summary
from riot_bus.log.gaps import Gaps
from riot_bus.log.limits import lifted
from riot_bus.log.loss import Loss
from riot_bus.log.reader import LogReader, channel_source, open_log

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from riot_bus.log.reader import ChannelSource
    from riot_bus.log.tables.blocks import LoadedBlock
    from riot_bus.types.capabilities import ReadsMetadata, Stamp


@dataclass(slots=True)
class TopicInfo:
    """One topic of a log.

    Attributes:
        originals: Originals of messages that were changed, delayed or dropped.
        bytes: Bytes of all payloads; None if the log was not read.
        first: Time of the first message, nanoseconds; approximate if the log was not read.
        last: Time of the last message, nanoseconds; approximate if the log was not read.
        missing: Gaps in the numbers that publishers gave their messages; None if the log was not read, or if they
            gave none.
    """

    topic: str
    key: str
    type: str
    encoding: str
    count: int = 0
    originals: int = 0
    bytes: int | None = 0
    first: int = 0
    last: int = 0
    missing: int | None = None

    @property
    def rate(self) -> float:
        """Messages per second over the topic's own duration, 0 if it cannot be told."""
        return (self.count - 1) * 1e9 / (self.last - self.first) if self.last > self.first else 0.0


@dataclass(frozen=True, slots=True)
class LogInfo:
    """An overview of a log.

    Attributes:
        topics: Facts about each topic, sorted by name.
        start: Time of the first message, nanoseconds; None if there is none.
        end: Time of the last message, nanoseconds; None if there is none.
        loss: Messages and blocks that cannot be read; unknown unless `scanned`.
        scanned: Whether all of the file was read, not only its summary.
        account: The recorder's own account of what it lost; None if it gave none.
    """

    path: str
    size: int
    profile: str
    topics: tuple[TopicInfo, ...]
    count: int
    start: int | None
    end: int | None
    metadata: dict[str, str]
    loss: Loss
    scanned: bool = True
    account: Account | None = None
    library: str = ""
    chunks: int = 0

    @property
    def seconds(self) -> float:
        """Time from the first to the last message."""
        return (self.end - self.start) / 1e9 if self.start is not None and self.end is not None else 0.0


def log_info(
    path: Path | str,
    *,
    scan: bool | None = None,
    progress: Callable[[int, int], None] | None = None,
    limits: LogLimits | None = None,
) -> LogInfo:
    """Return an overview of a log.

    Args:
        path: Path of the log.
        scan: Whether to read all of it, so that the loss is complete; False: only if its summary is not sound; None: if
            it is small (64 MiB), or if its summary is not sound.
        progress: Function that is called repeatedly with the number of bytes read and of the whole file.
        limits: Limits of what is read; None for the default ones, with the changes in `RIOT_LOG_LIMITS`.

    Raises:
        ConfigError: The file is not a log.
    """
    limits = lifted() if limits is None else limits
    if not scan:
        file = open_log(path)
        try:
            small = os.fstat(file).st_size <= 1 << 26  # it is soon read whole, which finds all losses
            summary = None if scan is None and small else read_summary(file, limits)
            if summary is not None:
                return _of_summary(str(path), file, summary, limits)
        finally:
            os.close(file)
    with LogReader(path, limits=limits) as reader:
        return _of_scan(reader, progress)


def _of_summary(path: str, file: int, summary: Summary, limits: LogLimits) -> LogInfo:
    topics: dict[str, TopicInfo] = {}
    spans, counts = summary.spans(), summary.statistics.channel_message_counts
    for number, channel in summary.channels.items():
        source = channel_source(channel, summary.schemas.get(channel.schema_id))
        topic = _topic(topics, source)
        topic.bytes = None
        count = counts.get(number, 0)
        if source.role == "original":
            topic.originals += count
        elif count and number in spans:
            _widen(topic, *spans[number])
            topic.count += count
    known = summary.statistics
    wanted = [(name, span) for name, span in summary.metadata if name in (layout.RUN, LOST)]
    notes = {name: read_metadata(file, span, limits) or {} for name, span in wanted}
    delivered = sum(topic.count for topic in topics.values())
    return LogInfo(
        path=path,
        size=summary.size,
        profile=summary.header.profile,
        topics=_ordered(topics),
        count=delivered,
        start=known.message_start_time if delivered else None,
        end=known.message_end_time if delivered else None,
        metadata=notes.get(layout.RUN, {}),
        loss=Loss(),
        scanned=False,
        account=account_of(notes.get(LOST, {})),
        library=summary.header.library,
        chunks=summary.chunks.count,
    )


def _of_scan(reader: LogReader, progress: Callable[[int, int], None] | None) -> LogInfo:
    from riot_bus.log.tables.blocks import load_ahead

    sources = reader.sources()
    topics: dict[str, TopicInfo] = {}
    for source in sources.values():
        _topic(topics, source)
    numbers = _Numbers()
    read = 0
    for block in load_ahead(reader, reader.blocks(), memory=reader.limits.held, threads=2, largest=reader.limits.chunk):
        _count(block, sources, topics)
        numbers.add(block, sources, topics, reader.extras_of(block.block, block.records.most_written))
        read += block.block.body.length
        if progress is not None:
            progress(read, reader.size)
    for _ in reader.provenance():
        pass  # so that damaged notes are counted
    accounts = [account_of(note) for note in reader.notes(LOST)]
    filled = [each for each in topics.values() if each.count]
    return LogInfo(
        path=reader.path,
        size=reader.size,
        profile=reader.profile,
        topics=_ordered(topics),
        count=sum(each.count for each in filled),
        start=min((each.first for each in filled), default=None),
        end=max((each.last for each in filled), default=None),
        metadata=dict(reader.metadata),
        loss=replace(reader.loss, salvageable=reader.salvageable()),
        account=accounts[-1] if accounts else None,
        library=reader.library,
        chunks=sum(block.chunked for block in reader.blocks()),
    )


def _topic(topics: dict[str, TopicInfo], source: ChannelSource) -> TopicInfo:
    return topics.setdefault(source.key, TopicInfo(source.topic, source.key, source.schema.name or "", source.encoding))


def _ordered(topics: dict[str, TopicInfo]) -> tuple[TopicInfo, ...]:
    return tuple(sorted(topics.values(), key=lambda each: (each.topic, each.key)))


def _widen(topic: TopicInfo, first: int, last: int) -> None:
    topic.first = min(topic.first, first) if topic.count else first
    topic.last = max(topic.last, last) if topic.count else last


def _count(block: LoadedBlock, sources: Any, topics: dict[str, TopicInfo]) -> None:
    lengths = block.lengths()
    for number, rows in block.by_channel():
        source, count = sources.get(number), len(rows)
        if source is None:
            continue
        topic = topics[source.key]
        if source.role == "original":
            topic.originals += count
            continue
        times = block.times[rows]
        _widen(topic, int(times.min()), int(times.max()))
        topic.count += count
        topic.bytes = (topic.bytes or 0) + int(lengths[rows].sum())


class _Numbers:
    """Finds gaps in the numbers that publishers give their messages; originals and copies have the same number."""

    def __init__(self) -> None:
        self._adapters: Sequence[ReadsMetadata] | None = None
        self._gaps = Gaps()

    def add(self, block: LoadedBlock, sources: Any, topics: dict[str, TopicInfo], extras: Any) -> None:
        """Process the messages of a block that have an attachment."""
        channels = block.channels
        for place, extra in extras.items():
            attachment = extra.get("a")
            if not isinstance(attachment, bytes) or not 0 <= place < len(channels):
                continue
            source = sources.get(int(channels[place]))
            stamp = self._stamp(attachment) if source is not None else None
            if stamp is not None:
                topic = topics[source.key]
                missed = self._gaps.see((topic.key, stamp.publisher), stamp.sequence)
                topic.missing = (topic.missing or 0) + missed

    def _stamp(self, attachment: bytes) -> Stamp | None:
        if self._adapters is None:
            from riot_bus.types.capabilities import ReadsMetadata
            from riot_bus.types.registry import load_adapters

            self._adapters = [each for each in load_adapters() if isinstance(each, ReadsMetadata)]
        for adapter in self._adapters:
            found = adapter.stamp(attachment)
            if found is not None:
                return found
        return None
