"""Writes a log: an MCAP file that ROS 2 tools and Foxglove read, and that is readable after a kill -9."""

from __future__ import annotations

import logging
import threading
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from riot_bus.log import layout
from riot_bus.log.engine.chunk import ChunkBuilder
from riot_bus.log.engine.mcap_file import McapFile
from riot_bus.log.layout import Provenance, Role
from riot_bus.log.log_channels import LogChannels
from riot_bus.log.writing_queue import Attempts, WritingQueue
from riot_bus.vocabulary.clock import SystemClock

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path
    from types import TracebackType

    from mcap.records import Channel, Schema

    from riot_bus.log.engine.chunk import Draft, Row
    from riot_bus.log.engine.ring import Ring
    from riot_bus.log.log_channels import ChannelWriter
    from riot_bus.pipeline.event import Change
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.clock import Clock
    from riot_bus.vocabulary.message import Message

_LOG = logging.getLogger(__name__)
_GONE = "the file was removed"
_LOOK_EVERY = 31  # a mask: one message in 32 asks the clock for the chunk's age


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSettings:
    """How a log is written.

    Attributes:
        compression: `zstd`, `lz4` or `none`.
        chunk_bytes: Size of a chunk before compression.
        chunk_seconds: Age at which `LogWriter.write` and `LogWriter.tick` end a chunk.
        threaded: Whether to compress and write on a separate thread; errors are then raised by a later call.
        durable: Whether to force written data to the disk once every `chunk_seconds`, to survive a power failure.
        queue_bytes: Bytes that may wait for that thread. Messages that do not fit after `patience` are lost; None to
            wait for as long as it takes.
        patience: Seconds to wait for room in the queue, unless `LogWriter.append` is told not to.
    """

    compression: str = "zstd"
    chunk_bytes: int = 1 << 20
    chunk_seconds: float = 1.0
    threaded: bool = False
    durable: bool = False
    queue_bytes: int | None = None
    patience: float = 1.0


_USUAL = LogSettings()


class LogWriter:
    """Writes messages to an MCAP file; safe to use from several threads.

    Chunks end by size or age. A chunk's extras and provenance are written before the chunk itself, so whatever
    survives is complete. When the disk fails, the file ends with the last complete chunk, LostMessagesError says what
    is lost, and writing is tried again with the next chunk.

    Args:
        path: File to create; an existing one is overwritten.
        settings: Chunks, compression, threads.
        registry: Names and types of topics; without one, topics are keys and types unknown.
        metadata: Metadata of the run, such as the seed; the reader returns it as `metadata`.
        profile: MCAP profile; `ros2` for logs that ROS 2 tools should read.
        clock: Clock that measures a chunk's age.
        channel_metadata: Function called once per key for more channel metadata, such as `offered_qos_profiles`.
        storage: Memory that keeps chunks instead of the file; the path is then only used in error messages.
        epilogue: Function that returns a metadata record to write last, when all messages are in the file.

    Attributes:
        refused: Messages that an MCAP file cannot hold: too many keys, or a time that is not 0 ... 2^64 - 1.
        gone: Whether the file has been removed; then nothing more is written.

    Raises:
        ConfigError: The file cannot be written.
    """

    def __init__(
        self,
        path: Path | str,
        settings: LogSettings = _USUAL,
        *,
        registry: TypeRegistry | None = None,
        metadata: Mapping[str, str] | None = None,
        profile: str | None = None,
        clock: Clock | None = None,
        channel_metadata: Callable[[str], Mapping[str, str]] | None = None,
        storage: Ring | None = None,
        epilogue: Callable[[LogWriter], tuple[str, Mapping[str, str]]] | None = None,
    ) -> None:
        self.path = str(path)
        self.refused = 0
        self.gone = False
        self._epilogue = epilogue
        self._now = (clock or SystemClock()).now
        self._chunk_bytes, self._chunk_ns = settings.chunk_bytes, int(settings.chunk_seconds * 1e9)
        self._durable, self._synced = settings.durable, 0
        self._lock = threading.Lock()
        self._builder = ChunkBuilder()
        self._channels = LogChannels(registry, channel_metadata, self._builder.define)
        self._known = self._channels.known
        self._provenance: list[Provenance] = []
        self._opened_at = self._looks = 0
        self._written: Counter[tuple[str, Role]] = Counter()
        self._file: McapFile | Ring = storage or McapFile(
            path, profile=profile or "", library=layout.LIBRARY, compression=settings.compression
        )
        self._linked = self._file.is_linked()  # not all file systems can tell
        self._queue = WritingQueue(
            self.path, threaded=settings.threaded, most_bytes=settings.queue_bytes, patience=settings.patience
        )
        self._closed = False
        if metadata:
            self.note(layout.RUN, metadata)

    @property
    def size(self) -> int:
        """Bytes in the file and on their way to it."""
        return self._file.size + self._queue.waiting + self._builder.size

    @property
    def queued_bytes(self) -> int:
        """Bytes that wait to be written, without the chunk under construction."""
        return self._queue.waiting

    @property
    def problem(self) -> str:
        """Reason why nothing can be written at present; empty as long as all is well."""
        return self._queue.problem

    @property
    def errno(self) -> int | None:
        """Number of that error, None if the operating system has none."""
        return self._queue.errno

    def write(self, message: Message, *, role: Role = "delivered", changes: Sequence[Change] = ()) -> None:
        """Write one message, or count it as refused if the file cannot hold it.

        Args:
            message: The message; its time becomes the log time.
            role: `original` for a message as it was before it was changed, delayed or dropped.
            changes: Changes that interceptors made to it.

        Raises:
            LostMessagesError: Earlier messages are lost, or the file is gone; this one is not written either.
        """
        with self._lock:
            if self.gone:
                raise self._queue.failure(_GONE, Counter())
            builder = self._builder
            self._looks += 1
            if builder.size >= self._chunk_bytes or (
                self._looks & _LOOK_EVERY == 0 and self._now() - self._opened_at >= self._chunk_ns
            ):
                self._end_chunk()
            try:
                track: ChannelWriter | None = self._known[role][message.key]
            except KeyError:
                track = self._channels.open(message, role)
            time = message.time
            if track is None or not 0 <= time < 1 << 64:
                self.refused += 1
                return
            number, constants = track
            extras = layout.extras_of(message, constants)
            published = message.publish_time
            if published is None or not 0 <= published < 1 << 64:
                published = time
            if builder.count == 0:
                self._opened_at = self._now()
            builder.fill(iter([(number, message.sequence & 0xFFFFFFFF, time, published, message.payload, extras)]), 0)
            if changes:
                self._provenance.append(Provenance(message.sequence, message.key, time, role, tuple(changes)))

    def track(self, message: Message) -> ChannelWriter | None:
        """Return what `append` needs for the messages of a key; None if the file can hold no more keys."""
        with self._lock:
            return self._known["delivered"].get(message.key) or self._channels.open(message, "delivered")

    def renew(self, key: str) -> None:
        """Make further messages of a key open new channels, since its type has become known.

        Callers must call `track` again for this key.
        """
        with self._lock:
            self._channels.renew(key)

    def append(self, rows: Sequence[Row], *, patient: bool = True) -> None:
        """Write many messages at once, as `write` does, from values that are already extracted.

        Args:
            rows: Tuples of channel number (from `track`), sequence (32 bits), time and publish time (64 bits),
                payload, and the result of `layout.extras_of`.
            patient: Whether to wait for room for up to `patience` seconds.

        Raises:
            LostMessagesError: The messages that it names are lost, of these rows or earlier ones.
        """
        with self._lock, Attempts() as attempt:
            if self.gone:
                raise self._queue.failure(_GONE, self._channels.by_name(Counter(row[0] for row in rows)))
            builder, now, feed = self._builder, self._now(), iter(rows)
            if builder.count and now - self._opened_at >= self._chunk_ns:
                attempt(self._end_chunk, patient)
            if not builder.count:
                self._opened_at = now
            while builder.fill(feed, self._chunk_bytes):
                attempt(self._end_chunk, patient)
                self._opened_at = now

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        """Write an MCAP metadata record; `LogReader.notes` returns it.

        Raises:
            LostMessagesError: The disk failed, now or before.
        """
        with self._lock:
            if not self._closed:
                self._queue.do(0, self._file.metadata, name, dict(mapping))

    def tick(self) -> None:
        """End a chunk that is old or large enough; call this regularly when messages are rare.

        Raises:
            LostMessagesError: The disk failed, or the file has been removed.
        """
        with self._lock:
            if self._closed:
                return
            self._look_for_the_file()
            self._queue.collect(0)
            full = self._builder.size >= self._chunk_bytes
            if self._builder.count and (full or self._now() - self._opened_at >= self._chunk_ns):
                self._end_chunk()

    def flush(self) -> None:
        """Wait until everything written so far is in the file, or known to be lost.

        Raises:
            LostMessagesError: The disk failed, now or before.
        """
        with self._lock, Attempts() as attempt:
            if not self._closed:
                self._flush(attempt)

    def counts(self) -> Mapping[int, int]:
        """Return how many messages of each channel are in the file; call `flush` first to count all of them."""
        return dict(self._file.statistics.channel_message_counts)

    def span(self) -> tuple[int, int]:
        """Return the times of the earliest and the latest message in the file, nanoseconds; 0 if there is none."""
        return self._file.statistics.message_start_time, self._file.statistics.message_end_time

    def definitions(self) -> tuple[list[Schema], list[Channel]]:
        """Return all schemas and channels so far."""
        with self._lock:
            return self._channels.schemas, list(self._channels.channels)

    def close(self) -> None:
        """Write what is left and the summary; safe to call twice.

        Raises:
            LostMessagesError: The disk failed, now or before; the file is closed all the same.
        """
        epilogue, self._epilogue = self._epilogue, None
        with Attempts() as attempt:
            if epilogue is not None:
                attempt(self.flush)
                attempt(lambda: self.note(*epilogue(self)))
            attempt(self._close)

    def _close(self) -> None:
        with self._lock:
            if self._closed:
                return
            self._closed = True
            queue, file = self._queue, self._file
            try:
                with Attempts() as attempt:
                    self._flush(attempt)
                    attempt(queue.do, 0, file.finish, self._channels.schemas, self._channels.channels)
                    attempt(queue.collect, None)
                    queue.collect_sync(attempt)
                    if self._durable:
                        attempt(queue.synchronise, file.sync)
            finally:
                queue.close()
                file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _flush(self, attempt: Attempts) -> None:
        attempt(self._look_for_the_file)
        attempt(self._end_chunk)
        attempt(self._queue.collect, None)

    def _look_for_the_file(self) -> None:
        if self._linked and not self.gone and not self._file.is_linked():
            self.gone = True
            with Attempts() as attempt:
                attempt(self._queue.collect, None)
                lost, self._written = self._written, Counter()
                lost += self._channels.by_name(self._builder.end().counts())
                attempt.add(self._queue.failure(_GONE, lost))

    def _end_chunk(self, patient: bool = True) -> None:  # noqa: FBT001, FBT002 - passed on by `Attempts`
        if not self._builder.count:
            return
        draft, provenance, self._provenance = self._builder.end(), self._provenance, []
        with Attempts() as attempt:
            if self._queue.has_room(draft.size, attempt, patient=patient):
                attempt(self._queue.do, draft.size, self._store, draft, provenance)
            else:
                for record in draft.definitions:
                    self._builder.define(record)
                lost = self._channels.by_name(draft.counts())
                attempt.add(self._queue.failure("the disk is too slow", lost, slow=True))

    def _store(self, draft: Draft, provenance: Sequence[Provenance]) -> None:
        try:
            chunk = draft.chunk()
            self._file.chunk(chunk, layout.companions(draft.extras, provenance))
        except Exception as error:  # such as no memory: what is lost must be counted all the same
            if not isinstance(error, OSError):
                _LOG.exception("a chunk of %s could not be made", self.path)
            reason = error if isinstance(error, OSError) else repr(error)
            raise self._queue.failure(reason, self._channels.by_name(draft.counts())) from error
        self._written.update(self._channels.by_name(chunk.counts))
        self._queue.problem = ""
        if self._durable and (now := self._now()) - self._synced >= self._chunk_ns:
            self._synced = now
            self._queue.sync(self._file.sync)
