"""Writes a log: an MCAP file that ROS 2 tools and Foxglove read, and that is readable after a kill -9."""

from __future__ import annotations

import logging
import re
import threading
from collections import Counter, deque
from concurrent.futures import Future, ThreadPoolExecutor, wait
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from mcap.records import Channel, Schema

from riot_bus.log import layout
from riot_bus.log.engine.chunk import ChunkBuilder
from riot_bus.log.engine.mcap_file import McapFile, record_bytes
from riot_bus.log.layout import Constants, Provenance, Role
from riot_bus.vocabulary.clock import SystemClock
from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path
    from types import TracebackType

    from riot_bus.log.engine.chunk import Draft, Row
    from riot_bus.log.engine.ring import Ring
    from riot_bus.pipeline.event import Change
    from riot_bus.types.model import Schema as Definition
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.clock import Clock
    from riot_bus.vocabulary.message import Message

_LOG = logging.getLogger(__name__)
_MAX_CHANNELS = 65_000  # just below what the 16 bits of MCAP's channel numbers allow
_OTHER_TOPICS = "(other topics)"
_GONE = "the file was removed"
_MOST_PENDING = 4  # chunks, by default of 1 MiB: bounds the memory where `queue_bytes` does not
_LOOK_EVERY = 31  # a mask: one message in 32 asks the clock for the chunk's age
_TYPE_HASH = re.compile(r"RIHS01_[0-9a-f]{64}")
# Integers, not names: readers of every ROS 2 release understand them (metadata version 8).
_DEFAULT_QOS = """- history: 1
  depth: 10
  reliability: 1
  durability: 2
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: 1
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false
"""
_MESSAGE_ENCODINGS = {"application/json": "json", "text/json": "json", "application/msgpack": "msgpack"}


class LostMessagesError(EnvironmentFaultError):
    """Messages are lost since the disk is full, slow or has failed; later ones may be written again.

    Attributes:
        reasons: Number of messages missing in the file, by reason (`disk`, `too slow`), key and role.
        errno: Error number of the operating system, None if it reported no error.
    """

    def __init__(
        self,
        reason: str,
        *,
        where: str,
        lost: Counter[tuple[str, Role]],
        errno: int | None = None,
        slow: bool = False,
    ) -> None:
        hint = "record less, or to a faster disk" if slow else "make room"
        super().__init__(f"the log cannot be written: {reason}", where=where, hint=hint)
        self.reasons = {"too slow" if slow else "disk": lost}
        self.errno = errno

    @property
    def lost(self) -> Counter[tuple[str, Role]]:
        """Number of messages lost for any reason, by key and role."""
        return sum(self.reasons.values(), Counter())

    def add(self, other: LostMessagesError) -> None:
        """Add the losses of another error to this one."""
        for reason, lost in other.reasons.items():
            self.reasons[reason] = self.reasons.get(reason, Counter()) + lost


class ChannelWriter(NamedTuple):
    """What `append` needs to know about a channel: its number, and what its messages have in common."""

    number: int
    constants: Constants


class _Attempts:
    """A context in which steps are carried out though earlier ones failed; at its end, their losses are raised."""

    def __init__(self) -> None:
        self._failures: list[LostMessagesError] = []

    def __call__(self, step: Callable[..., object], *arguments: Any) -> None:
        """Carry out a step, and keep what it raises."""
        try:
            step(*arguments)
        except LostMessagesError as error:
            self.add(error)

    def add(self, error: LostMessagesError) -> None:
        """Keep an error."""
        self._failures.append(error)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if self._failures and error is None:
            *earlier, last = self._failures
            for each in earlier:
                last.add(each)
            raise last


class LogWriter:
    """Writes messages to an MCAP file; safe to use from several threads.

    Chunks end by size or age. A chunk's extras and provenance are written before the chunk itself, so whatever
    survives is complete. When the disk fails, the file ends with the last complete chunk, LostMessagesError says what
    is lost, and writing is tried again with the next chunk.

    Args:
        path: File to create; an existing one is overwritten.
        registry: Names and types of topics; without one, topics are keys and types unknown.
        metadata: Metadata of the run, such as the seed; the reader returns it as `metadata`.
        profile: MCAP profile; `ros2` for logs that ROS 2 tools should read.
        compression: `zstd`, `lz4` or `none`.
        chunk_bytes: Size of a chunk before compression.
        chunk_seconds: Age at which `write` and `tick` end a chunk.
        clock: Clock that measures a chunk's age.
        channel_metadata: Function called once per key for more channel metadata, such as `offered_qos_profiles`.
        threaded: Whether to compress and write on a separate thread; errors are then raised by a later call.
        durable: Whether to force written data to the disk once every `chunk_seconds`, to survive a power failure.
        queue_bytes: Bytes that may wait for that thread. Messages that do not fit after `patience` are lost; None to
            wait for as long as it takes.
        patience: Seconds to wait for room in the queue, unless `append` is told not to. After a wait in vain, no call
            waits until the queue is at most half full, so that many chunks in a row cannot stall the caller together.
        storage: Memory that keeps chunks instead of the file; the path is then only used in error messages.
        epilogue: Function that returns a metadata record to write last, when all messages are in the file.

    Attributes:
        lost: Messages per topic that an MCAP file cannot hold: too many keys, or a time that is not 0 ... 2^64 - 1.
        refused: Total number of these messages.
        problem: Reason why nothing can be written at present; empty as long as all is well.
        errno: Number of that error, None if the operating system has none.
        gone: Whether the file has been removed; then nothing more is written.
        profile: The file's MCAP profile.

    Raises:
        ConfigError: The file cannot be written.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        registry: TypeRegistry | None = None,
        metadata: Mapping[str, str] | None = None,
        profile: str | None = None,
        compression: str = "zstd",
        chunk_bytes: int = 1 << 20,
        chunk_seconds: float = 1.0,
        clock: Clock | None = None,
        channel_metadata: Callable[[str], Mapping[str, str]] | None = None,
        threaded: bool = False,
        durable: bool = False,
        queue_bytes: int | None = None,
        patience: float = 1.0,
        storage: Ring | None = None,
        epilogue: Callable[[LogWriter], tuple[str, Mapping[str, str]]] | None = None,
    ) -> None:
        self.path = str(path)
        self._epilogue = epilogue
        self.profile = profile or ""
        self.lost: Counter[str] = Counter()
        self.refused = 0
        self.problem = ""
        self.errno: int | None = None
        self.gone = False
        self._registry = registry
        self._more_metadata = channel_metadata
        self._now = (clock or SystemClock()).now
        self._chunk_bytes, self._chunk_ns, self._durable = chunk_bytes, int(chunk_seconds * 1e9), durable
        self._lock = threading.Lock()
        self._known: dict[Role, dict[str, ChannelWriter | None]] = {"delivered": {}, "original": {}}
        self._names: dict[int, tuple[str, Role]] = {}
        self._channels: list[Channel] = []
        self._schemas: dict[tuple[str, bytes], Schema] = {}
        self._builder = ChunkBuilder()
        self._provenance: list[Provenance] = []
        self._opened_at = 0
        self._looks = 0
        self._written: Counter[tuple[str, Role]] = Counter()
        self._pending: deque[tuple[Future[None], int]] = deque()
        self._queued = 0
        self._queue_bytes, self._patience, self._overrun = queue_bytes, patience, False
        self._file: McapFile | Ring = storage or McapFile(
            path, profile=self.profile, library=layout.LIBRARY, compression=compression
        )
        self._linked = self._file.is_linked()  # not all file systems can tell
        self._synced = 0
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="riot-write") if threaded else None
        self._syncer = ThreadPoolExecutor(1, thread_name_prefix="riot-sync") if threaded and durable else None
        self._syncing: Future[None] | None = None
        self._closed = False
        if metadata:
            self.note(layout.RUN, metadata)

    @property
    def size(self) -> int:
        """Bytes in the file and on their way to it."""
        return self._file.size + self._queued + self._builder.size

    @property
    def queued_bytes(self) -> int:
        """Bytes that wait to be written, without the chunk under construction."""
        return self._queued

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
                raise self._failure(_GONE, Counter())
            builder = self._builder
            self._looks += 1
            if builder.size >= self._chunk_bytes or (
                self._looks & _LOOK_EVERY == 0 and self._now() - self._opened_at >= self._chunk_ns
            ):
                self._end_chunk()
            try:
                track = self._known[role][message.key]
            except KeyError:
                track = self._open_channel(message, role)
            time = message.time
            if track is None or not 0 <= time < 1 << 64:
                self._refuse(message.key)
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
            try:
                return self._known["delivered"][message.key]
            except KeyError:
                return self._open_channel(message, "delivered")

    def renew(self, key: str) -> None:
        """Make further messages of a key open new channels, since its type has become known.

        Callers must call `track` again for this key.
        """
        with self._lock:
            for known in self._known.values():
                known.pop(key, None)

    def refuse(self, key: str, count: int = 1) -> None:
        """Count messages that the file cannot hold."""
        with self._lock:
            self._refuse(key, count)

    def append(self, rows: Sequence[Row], *, patient: bool = True) -> None:
        """Write many messages at once, as `write` does, from values that are already extracted.

        Args:
            rows: Tuples of channel number (from `track`), sequence (32 bits), time and publish time (64 bits),
                payload, and the result of `layout.extras_of`.
            patient: Whether to wait for room for up to `patience` seconds.

        Raises:
            LostMessagesError: The messages that it names are lost, of these rows or earlier ones.
        """
        with self._lock, _Attempts() as attempt:
            if self.gone:
                lost = Counter(self._names[row[0]] for row in rows)
                raise self._failure(_GONE, lost)
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
                self._do(0, self._file.metadata, name, dict(mapping))

    def tick(self) -> None:
        """End a chunk that is old or large enough; call this regularly when messages are rare.

        Raises:
            LostMessagesError: The disk failed, or the file has been removed.
        """
        with self._lock:
            if self._closed:
                return
            self._look_for_the_file()
            self._collect(0)
            full = self._builder.size >= self._chunk_bytes
            if self._builder.count and (full or self._now() - self._opened_at >= self._chunk_ns):
                self._end_chunk()

    def flush(self) -> None:
        """Wait until everything written so far is in the file, or known to be lost.

        Raises:
            LostMessagesError: The disk failed, now or before.
        """
        with self._lock, _Attempts() as attempt:
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
            return list(self._schemas.values()), list(self._channels)

    def close(self) -> None:
        """Write what is left and the summary; safe to call twice.

        Raises:
            LostMessagesError: The disk failed, now or before; the file is closed all the same.
        """
        epilogue, self._epilogue = self._epilogue, None
        with _Attempts() as attempt:
            if epilogue is not None:
                attempt(self.flush)
                attempt(lambda: self.note(*epilogue(self)))
            attempt(self._close)

    def _close(self) -> None:
        with self._lock:
            if self._closed:
                return
            self._closed = True
            try:
                with _Attempts() as attempt:
                    self._flush(attempt)
                    attempt(self._do, 0, self._file.finish, list(self._schemas.values()), self._channels)
                    attempt(self._collect, None)
                    self._collect_sync(attempt, to_the_end=True)
                    if self._durable:
                        attempt(self._synchronise)
            finally:
                for thread in (self._thread, self._syncer):
                    if thread is not None:
                        thread.shutdown()
                self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _flush(self, attempt: _Attempts) -> None:
        attempt(self._look_for_the_file)
        attempt(self._end_chunk)
        attempt(self._collect, None)

    def _look_for_the_file(self) -> None:
        if self._linked and not self.gone and not self._file.is_linked():
            self.gone = True
            with _Attempts() as attempt:
                attempt(self._collect, None)
                lost, self._written = self._written, Counter()
                lost += self._by_name(self._builder.end().counts())
                attempt.add(self._failure(_GONE, lost))

    def _end_chunk(self, patient: bool = True) -> None:  # noqa: FBT001, FBT002 - passed on by `_Attempts`
        if not self._builder.count:
            return
        draft, provenance, self._provenance = self._builder.end(), self._provenance, []
        with _Attempts() as attempt:
            most = self._queue_bytes if self._thread is not None else None
            if most is None or self._make_room(most, draft.size, attempt, patient=patient):
                attempt(self._do, draft.size, self._store, draft, provenance)
            else:
                for record in draft.definitions:
                    self._builder.define(record)
                attempt.add(self._failure("the disk is too slow", self._by_name(draft.counts()), slow=True))

    def _make_room(self, most: int, size: int, attempt: _Attempts, *, patient: bool) -> bool:
        """Return whether the queue has room for another chunk; wait for it up to `patience` where that helps."""
        deadline = monotonic() + self._patience
        attempt(self._collect, 0)
        if 2 * self._queued <= most:
            self._overrun = False
        while self._pending and self._queued + size > most:
            left = deadline - monotonic()
            if not patient or self._overrun or left <= 0.0:
                self._overrun = True
                return False
            wait([self._pending[0][0]], timeout=left)
            attempt(self._collect, 0)
        return True

    def _do(self, size: int, action: Callable[..., None], *arguments: Any) -> None:
        """Run an action on the file, now or on the writing thread."""
        if self._thread is None:
            try:
                action(*arguments)
            except OSError as error:
                raise self._failure(error, Counter()) from error
        else:
            self._pending.append((self._thread.submit(action, *arguments), size))
            self._queued += size
            self._collect(_MOST_PENDING if self._queue_bytes is None else 0)

    def _collect(self, most: int | None) -> None:
        """Collect finished actions; wait until at most `most` are pending (None: until none is; 0: do not wait)."""
        with _Attempts() as attempt:
            self._collect_sync(attempt, to_the_end=False)
            while self._pending and (most is None or self._pending[0][0].done() or 0 < most < len(self._pending)):
                future, size = self._pending[0]
                error = future.exception()
                self._pending.popleft()
                self._queued -= size
                if isinstance(error, OSError):
                    error = self._failure(error, Counter())
                if isinstance(error, LostMessagesError):
                    attempt.add(error)
                elif error is not None:
                    raise error

    def _store(self, draft: Draft, provenance: Sequence[Provenance]) -> None:
        try:
            chunk = draft.chunk()
            self._file.chunk(chunk, layout.companions(draft.extras, provenance))
        except OSError as error:
            raise self._failure(error, self._by_name(draft.counts())) from error
        except Exception as error:  # such as no memory: what is lost must be counted all the same
            _LOG.exception("a chunk of %s could not be made", self.path)
            raise self._failure(repr(error), self._by_name(draft.counts())) from error
        self._written.update(self._by_name(chunk.counts))
        self.problem = ""
        if self._durable and (now := self._now()) - self._synced >= self._chunk_ns:
            self._synced = now
            self._sync()

    def _sync(self) -> None:
        """Force written data to the disk, on a thread of its own if there is one, so that chunks need not wait."""
        if self._syncer is None:
            self._synchronise()
        elif self._syncing is None:
            self._syncing = self._syncer.submit(self._synchronise)

    def _synchronise(self) -> None:
        try:
            self._file.sync()
        except OSError as error:  # what was written may be there all the same
            raise self._failure(error, Counter()) from error

    def _collect_sync(self, attempt: _Attempts, *, to_the_end: bool) -> None:
        if self._syncing is not None and (to_the_end or self._syncing.done()):
            syncing, self._syncing = self._syncing, None
            attempt(syncing.result)

    def _by_name(self, counts: Mapping[int, int]) -> Counter[tuple[str, Role]]:
        return Counter({self._names[channel]: count for channel, count in counts.items()})

    def _failure(
        self, error: OSError | str, lost: Counter[tuple[str, Role]], *, slow: bool = False
    ) -> LostMessagesError:
        reason = error if isinstance(error, str) else error.strerror or str(error)
        self.errno = None if isinstance(error, str) else error.errno
        failure = LostMessagesError(reason, where=self.path, lost=lost, errno=self.errno, slow=slow)
        self.problem = failure.message
        return failure

    def _refuse(self, key: str, count: int = 1) -> None:
        self.refused += count
        topic = key if self._registry is None else self._registry.topic(key)
        self.lost[topic if topic in self.lost or len(self.lost) < _MAX_CHANNELS else _OTHER_TOPICS] += count

    def _open_channel(self, message: Message, role: Role) -> ChannelWriter | None:
        key = message.key
        topic, kind = key, None
        if self._registry is not None:
            topic = self._registry.topic(key)
            kind = self._registry.type_of(key, payload=message.payload, encoding=message.encoding)
        if len(self._channels) >= _MAX_CHANNELS:
            return None
        constants = Constants.of(message)
        metadata = {layout.KEY: key, layout.TOPIC: topic, layout.ROLE: role, **constants.to_metadata()}
        schema = kind.schema if kind else None
        encoding = kind.encoding if kind else _MESSAGE_ENCODINGS.get(message.encoding, message.encoding)
        if (
            kind is None
            and self._registry is not None
            and (adapter := self._registry.metadata_adapter(key)) is not None
        ):
            schema, encoding = adapter.definition(key) or (None, encoding)
        if encoding == "cdr":
            found = _TYPE_HASH.search(key)
            metadata |= {"offered_qos_profiles": _DEFAULT_QOS, "topic_type_hash": found.group() if found else ""}
        if self._more_metadata is not None:
            metadata |= self._more_metadata(key)
        channel = Channel(
            id=len(self._channels) + 1,
            topic=layout.channel_name(topic, role),
            message_encoding=encoding,
            metadata=metadata,
            schema_id=self._schema_id(schema),
        )
        self._channels.append(channel)
        self._builder.define(record_bytes(channel))
        self._names[channel.id] = key, role
        track = self._known[role][key] = ChannelWriter(channel.id, constants)
        return track

    def _schema_id(self, schema: Definition | None) -> int:
        if schema is None:
            return 0
        identity = (schema.name, schema.data)
        found = self._schemas.get(identity)
        if found is None:
            number = len(self._schemas) + 1
            found = Schema(id=number, data=schema.data, encoding=schema.encoding, name=schema.name)
            self._schemas[identity] = found
            self._builder.define(record_bytes(found))
        return found.id
