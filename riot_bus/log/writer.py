"""Write a log: an MCAP file that ROS 2 tools and Foxglove read, and that is readable after a kill -9."""

from __future__ import annotations

import re
import threading
from collections import Counter
from typing import TYPE_CHECKING, Any, Self

from mcap.writer import CompressionType, Writer

from riot_bus.clock import SystemClock
from riot_bus.errors import ConfigError, did_you_mean
from riot_bus.log import layout
from riot_bus.log.layout import Constants, Provenance, Role

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path
    from types import TracebackType

    from riot_bus.clock import Clock
    from riot_bus.message import Message
    from riot_bus.pipeline.event import Change
    from riot_bus.types.model import MessageType
    from riot_bus.types.registry import TypeRegistry

__all__ = ["LogWriter"]

_COMPRESSIONS = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}
_NEVER = 1 << 62
_MAX_CHANNELS = 65_000
_RECORD_BYTES = 31
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


class LogWriter:
    """Writes messages to an MCAP file; safe to use from several threads.

    Chunks end by size or age. A chunk's extras and provenance are written before the chunk itself, so whatever
    survives is complete.

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

    Attributes:
        lost: Messages per topic that an MCAP file cannot hold: too many keys, or a time that is not 0 ... 2^64 - 1.
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
    ) -> None:
        if compression not in _COMPRESSIONS:
            hint = did_you_mean(compression, _COMPRESSIONS)
            raise ConfigError(f"unknown compression {compression!r}", where=str(path), hint=hint)
        self.lost: Counter[str] = Counter()
        self._registry = registry
        self._more_metadata = channel_metadata
        self._clock = clock or SystemClock()
        self._chunk_bytes, self._chunk_ns = chunk_bytes, int(chunk_seconds * 1e9)
        self._lock = threading.Lock()
        self._channels: dict[tuple[str, Role], tuple[int, Constants]] = {}
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._extras: list[tuple[int, dict[str, Any]]] = []
        self._provenance: list[Provenance] = []
        self._size = self._messages = 0
        self._opened_at = 0
        try:
            self._file = open(path, "wb")  # noqa: SIM115 - closed by close()
        except OSError as error:
            raise ConfigError(f"cannot write the log: {error.strerror}", where=str(path)) from error
        # The chunk size is ours to watch, because extras have to come before their chunk.
        self._mcap = Writer(self._file, chunk_size=_NEVER, compression=_COMPRESSIONS[compression])
        self._mcap.start(profile=profile or "", library=layout.LIBRARY)
        if metadata:
            self._mcap.add_metadata(layout.RUN, dict(metadata))
        self._file.flush()

    def write(self, message: Message, *, role: Role = "delivered", changes: Sequence[Change] = ()) -> None:
        """Write one message.

        Args:
            message: What to write.
            role: `original` for a message as it was before it was changed, delayed or dropped.
            changes: What interceptors did to it.
        """
        with self._lock:
            known = self._channels.get((message.key, role))
            if known is None:
                known = self._open_channel(message, role)
                if known is None:
                    return
            channel, constants = known
            if not 0 <= message.time < 1 << 64:
                self.lost[message.key if self._registry is None else self._registry.topic(message.key)] += 1
                return
            if self._messages == 0:
                self._opened_at = self._clock.now()
            extras = layout.extras_of(message, constants)
            published = message.publish_time
            payload = message.payload
            if published is None or not 0 <= published < 1 << 64:
                published = message.time
            self._mcap.add_message(channel, message.time, payload, published, message.sequence & 0xFFFFFFFF)
            if extras is not None:
                self._extras.append((self._messages, extras))
                self._size += len(message.attachment or b"")
            if changes:
                self._provenance.append(
                    Provenance(message.sequence, message.key, message.time, role, tuple(changes)),
                )
            self._messages += 1
            self._size += len(payload) + _RECORD_BYTES
            if self._size >= self._chunk_bytes or self._clock.now() - self._opened_at >= self._chunk_ns:
                self._end_chunk()

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        """Write an MCAP metadata record; `LogReader.notes` gives it back.

        Args:
            name: Such as `riot_bus.graph`.
            mapping: Keys and texts.
        """
        with self._lock:
            if not self._file.closed:
                self._mcap.add_metadata(name, dict(mapping))
                self._file.flush()

    def tick(self) -> None:
        """End a chunk that is old enough; call it now and then when messages are rare."""
        with self._lock:
            if self._messages and self._clock.now() - self._opened_at >= self._chunk_ns:
                self._end_chunk()

    def close(self) -> None:
        """Write what is left and the summary; safe to call twice."""
        with self._lock:
            if self._file.closed:
                return
            try:
                self._end_chunk()
                self._mcap.finish()  # type: ignore[no-untyped-call]
            finally:
                self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _end_chunk(self) -> None:
        if self._extras:
            data = layout.pack_extras(self._extras)
            self._mcap.add_attachment(0, 0, layout.EXTRAS, layout.EXTRAS_TYPE, data)
            self._extras = []
        if self._provenance:
            self._mcap.add_metadata(layout.PROVENANCE, {"changes": layout.pack_provenance(self._provenance)})
            self._provenance = []
        self._size = self._messages = 0
        self._mcap.flush()  # type: ignore[no-untyped-call]

    def _open_channel(self, message: Message, role: Role) -> tuple[int, Constants] | None:
        key = message.key
        topic, kind = key, None
        if self._registry is not None:
            topic = self._registry.topic(key)
            kind = self._registry.type_of(key, payload=message.payload, encoding=message.encoding)
        if len(self._channels) >= _MAX_CHANNELS:
            self.lost[topic] += 1
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
        channel = self._mcap.register_channel(name, encoding, self._schema_id(kind), metadata)
        self._channels[key, role] = channel, constants
        return channel, constants

    def _schema_id(self, kind: MessageType | None) -> int:
        schema = kind.schema if kind is not None else None
        if schema is None:
            return 0
        identity = (schema.name, schema.data)
        if identity not in self._schemas:
            self._schemas[identity] = self._mcap.register_schema(schema.name, schema.encoding, schema.data)
        return self._schemas[identity]
