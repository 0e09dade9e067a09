"""Write a log: an MCAP file that ROS 2 tools and Foxglove read, and that is readable after a kill -9."""

from __future__ import annotations

import re
import threading
from collections import Counter, deque
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from mcap.records import Channel, Schema

from riot_bus.clock import SystemClock
from riot_bus.errors import EnvironmentFaultError
from riot_bus.log import layout
from riot_bus.log.chunk import Chunk, ChunkBuilder
from riot_bus.log.layout import Constants, Provenance, Role
from riot_bus.log.mcap_file import McapFile, record_bytes

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path
    from types import TracebackType

    from riot_bus.clock import Clock
    from riot_bus.message import Message
    from riot_bus.pipeline.event import Change
    from riot_bus.types.model import MessageType
    from riot_bus.types.registry import TypeRegistry

__all__ = ["LogWriter", "LostMessagesError"]

_MAX_CHANNELS = 65_000
_OTHER_TOPICS = "(other topics)"
_MOST_WAITING = 4
_LOOK_EVERY = 31
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
    """The disk is full or has failed; what comes later may be written again.

    Attributes:
        lost: Messages, by key and role, that were written and yet are not in the file.
    """

    def __init__(self, reason: str, *, where: str, lost: Counter[tuple[str, Role]]) -> None:
        super().__init__(f"the log cannot be written: {reason}", where=where, hint="make room")
        self.lost = lost


class _Batch(NamedTuple):
    chunk: Chunk
    extras: bytes | None
    provenance: str | None


class LogWriter:
    """Writes messages to an MCAP file; safe to use from several threads.

    Chunks end by size or age. A chunk's extras and provenance are written before the chunk itself, so whatever
    survives is complete. When the disk fails, the file ends with the last whole chunk, LostMessagesError tells what is
    lost, and the next chunk is tried again.

    Args:
        path: File to create; an existing one is overwritten.
        registry: Names topics and knows their types; without one, topics are keys and types unknown.
        metadata: What the reader gives back as `metadata`, such as the seed.
        profile: MCAP profile; `ros2` for logs that ROS 2 tools shall read.
        compression: `zstd`, `lz4` or `none`.
        chunk_bytes: Size of a chunk before compression.
        chunk_seconds: Age at which `write` and `tick` end a chunk.
        clock: Tells a chunk's age.
        channel_metadata: Asked once per key for more channel metadata, such as `offered_qos_profiles`.
        threaded: Compress and write on a thread of its own; errors are then raised by a later call.
        durable: Make sure once in `chunk_seconds` that what is written is on the disk, whatever happens to the power.

    Attributes:
        lost: Messages per topic that an MCAP file cannot hold: too many keys, or a time that is not 0 ... 2^64 - 1.
        refused: Their number.
        problem: Why nothing can be written at present; empty as long as all is well.

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
    ) -> None:
        self.path = str(path)
        self.lost: Counter[str] = Counter()
        self.refused = 0
        self.problem = ""
        self._registry = registry
        self._more_metadata = channel_metadata
        self._now = (clock or SystemClock()).now
        self._chunk_bytes, self._chunk_ns, self._durable = chunk_bytes, int(chunk_seconds * 1e9), durable
        self._lock = threading.Lock()
        self._known: dict[Role, dict[str, tuple[int, Constants] | None]] = {"delivered": {}, "original": {}}
        self._names: dict[int, tuple[str, Role]] = {}
        self._channels: list[Channel] = []
        self._schemas: dict[tuple[str, bytes], Schema] = {}
        self._builder = ChunkBuilder()
        self._extras: list[tuple[int, dict[str, Any]]] = []
        self._extra_bytes = 0
        self._provenance: list[Provenance] = []
        self._opened_at = 0
        self._written: Counter[tuple[str, Role]] = Counter()
        self._waiting: deque[Future[None]] = deque()
        self._file = McapFile(path, profile=profile or "", library=layout.LIBRARY, compression=compression)
        self._linked = self._file.is_linked()  # not all file systems know
        self._gone = False
        self._synced = 0
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="riot-write") if threaded else None
        self._closed = False
        if metadata:
            self.note(layout.RUN, metadata)

    def write(self, message: Message, *, role: Role = "delivered", changes: Sequence[Change] = ()) -> None:
        """Write one message.

        Args:
            message: What to write.
            role: `original` for a message as it was before it was changed, delayed or dropped.
            changes: What interceptors did to it.

        Raises:
            LostMessagesError: Others are lost, and this one is not written either.
        """
        with self._lock:
            if self._gone:
                raise self._failure("the file was removed", Counter())
            builder = self._builder
            if builder.size + self._extra_bytes >= self._chunk_bytes or (
                builder.count & _LOOK_EVERY == _LOOK_EVERY and self._now() - self._opened_at >= self._chunk_ns
            ):
                self._end_chunk()
            try:
                known = self._known[role][message.key]
            except KeyError:
                known = self._open_channel(message, role)
            time = message.time
            if known is None or not 0 <= time < 1 << 64:
                self._refuse(message.key)
                return
            channel, constants = known
            extras = layout.extras_of(message, constants)
            published = message.publish_time
            if published is None or not 0 <= published < 1 << 64:
                published = time
            if builder.count == 0:
                self._opened_at = self._now()
            if extras is not None:
                self._extras.append((builder.count, extras))
                self._extra_bytes += len(message.attachment or b"")
            builder.add(channel, message.sequence & 0xFFFFFFFF, time, published, message.payload)
            if changes:
                self._provenance.append(Provenance(message.sequence, message.key, time, role, tuple(changes)))

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        """Write an MCAP metadata record; `LogReader.notes` gives it back.

        Args:
            name: Such as `riot_bus.graph`.
            mapping: Keys and texts.

        Raises:
            LostMessagesError: The disk failed, now or before.
        """
        with self._lock:
            if not self._closed:
                self._do(self._note, name, dict(mapping))

    def tick(self) -> None:
        """End a chunk that is old enough; call it now and then when messages are rare.

        Raises:
            LostMessagesError: The disk failed, or somebody has removed the file.
        """
        with self._lock:
            if self._closed:
                return
            self._look_for_the_file()
            self._collect(0)
            full = self._builder.size >= self._chunk_bytes
            if self._builder.count and (full or self._now() - self._opened_at >= self._chunk_ns):
                self._end_chunk()

    def close(self) -> None:
        """Write what is left and the summary; safe to call twice.

        Raises:
            LostMessagesError: The disk failed, now or before; the file is closed all the same.
        """
        with self._lock:
            if self._closed:
                return
            self._closed = True
            failures: list[LostMessagesError] = []
            try:
                for step in (self._look_for_the_file, self._end_chunk, self._finish, partial(self._collect, None)):
                    try:
                        step()
                    except LostMessagesError as error:
                        failures.append(error)
                if failures:
                    failures[-1].lost = sum((each.lost for each in failures), Counter())
                    raise failures[-1]
            finally:
                if self._thread is not None:
                    self._thread.shutdown()
                self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _look_for_the_file(self) -> None:
        if self._linked and not self._gone and not self._file.is_linked():
            self._gone = True
            self._collect(None)
            lost, self._written = self._written, Counter()
            lost.update({self._names[channel]: count for channel, count in self._builder.take().counts.items()})
            raise self._failure("the file was removed", lost)

    def _end_chunk(self) -> None:
        if not self._builder.count:
            return
        extras = layout.pack_extras(self._extras) if self._extras else None
        provenance = layout.pack_provenance(self._provenance) if self._provenance else None
        batch = _Batch(self._builder.take(), extras, provenance)
        self._extras, self._provenance, self._extra_bytes = [], [], 0
        self._do(self._store, batch)

    def _do(self, action: Callable[..., None], *arguments: Any) -> None:
        """Do something with the file, now or on the other thread."""
        if self._thread is None:
            try:
                action(*arguments)
            except OSError as error:
                raise self._failure(error, Counter()) from error
        else:
            self._waiting.append(self._thread.submit(action, *arguments))
            self._collect(_MOST_WAITING)

    def _collect(self, most: int | None) -> None:
        """Take note of what is done; wait until no more than `most` is not (None: nothing; 0: do not wait)."""
        lost: Counter[tuple[str, Role]] = Counter()
        failure: LostMessagesError | None = None
        while self._waiting and (most is None or self._waiting[0].done() or 0 < most < len(self._waiting)):
            error = self._waiting.popleft().exception()
            if isinstance(error, OSError):
                error = self._failure(error, Counter())
            if isinstance(error, LostMessagesError):
                lost += error.lost
                failure = error
            elif error is not None:
                raise error
        if failure is not None:
            failure.lost = lost
            raise failure

    def _store(self, batch: _Batch) -> None:
        lost = Counter({self._names[channel]: count for channel, count in batch.chunk.counts.items()})
        try:
            with self._file.together():
                if batch.extras is not None:
                    self._file.attachment(layout.EXTRAS, layout.EXTRAS_TYPE, batch.extras)
                if batch.provenance is not None:
                    self._file.metadata(layout.PROVENANCE, {"changes": batch.provenance})
                self._file.chunk(batch.chunk)
            if self._durable and (now := self._now()) - self._synced >= self._chunk_ns:
                self._synced = now
                self._file.sync()
        except OSError as error:
            raise self._failure(error, lost) from error
        self._written.update(lost)
        self.problem = ""

    def _finish(self) -> None:
        self._do(self._file.finish, list(self._schemas.values()), self._channels)

    def _note(self, name: str, mapping: dict[str, str]) -> None:
        self._file.metadata(name, mapping)

    def _failure(self, error: OSError | str, lost: Counter[tuple[str, Role]]) -> LostMessagesError:
        reason = error if isinstance(error, str) else error.strerror or str(error)
        failure = LostMessagesError(reason, where=self.path, lost=lost)
        self.problem = failure.message
        return failure

    def _refuse(self, key: str) -> None:
        self.refused += 1
        topic = key if self._registry is None else self._registry.topic(key)
        self.lost[topic if topic in self.lost or len(self.lost) < _MAX_CHANNELS else _OTHER_TOPICS] += 1

    def _open_channel(self, message: Message, role: Role) -> tuple[int, Constants] | None:
        key = message.key
        topic, kind = key, None
        if self._registry is not None:
            topic = self._registry.topic(key)
            kind = self._registry.type_of(key, payload=message.payload, encoding=message.encoding)
        if len(self._channels) >= _MAX_CHANNELS:
            return None
        constants = Constants.of(message)
        metadata = {layout.KEY: key, layout.TOPIC: topic, layout.ROLE: role, **constants.to_metadata()}
        if kind is not None and kind.encoding == "cdr":
            found = _TYPE_HASH.search(key)
            metadata |= {"offered_qos_profiles": _DEFAULT_QOS, "topic_type_hash": found.group() if found else ""}
        if self._more_metadata is not None:
            metadata |= self._more_metadata(key)
        name = topic if role == "delivered" else layout.ORIGINAL_PREFIX + topic.lstrip("/")
        encoding = kind.encoding if kind else _MESSAGE_ENCODINGS.get(message.encoding, message.encoding)
        channel = Channel(
            id=len(self._channels) + 1,
            topic=name,
            message_encoding=encoding,
            metadata=metadata,
            schema_id=self._schema_id(kind),
        )
        self._channels.append(channel)
        self._builder.define(record_bytes(channel))
        self._names[channel.id] = key, role
        known = self._known[role][key] = channel.id, constants
        return known

    def _schema_id(self, kind: MessageType | None) -> int:
        schema = kind.schema if kind is not None else None
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
