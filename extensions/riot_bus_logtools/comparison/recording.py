"""One side of a comparison: the messages of each topic by hash and time, some of them with their content."""

from __future__ import annotations

import tempfile
import weakref
from array import array
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import TYPE_CHECKING

from riot_bus.log.tables.blocks import LATEST
from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from riot_bus.types.registry import TypeRegistry

_IN_MEMORY = 1 << 26  # bytes of payloads; what exceeds this is in a file, so memory is bounded
HASH_BYTES = 16  # 128 bits: among 1e9 messages, two collide with a chance of 1.5e-21


@dataclass(slots=True)
class Track:
    """The messages of one topic, in order.

    Attributes:
        type: Name of the messages' type; empty if it is unknown.
        attachments: Whether attachments are content, not metadata of a middleware.
        times: Reception times, nanoseconds.
    """

    key: str
    topic: str
    type: str = ""
    attachments: bool = True
    hashes: list[bytes] = field(default_factory=list)
    times: array[int] = field(default_factory=lambda: array("q"))
    places: array[int] = field(default_factory=lambda: array("q"))
    encodings: set[str] = field(default_factory=set)

    def __len__(self) -> int:
        return len(self.hashes)

    def add(self, message: Message, place: int) -> None:
        """Add the next message."""
        digest = blake2b(message.payload, digest_size=HASH_BYTES)
        if message.kind == "delete":
            digest.update(b"delete")
        if self.attachments and message.attachment is not None:
            digest.update(len(message.attachment).to_bytes(8, "little") + message.attachment)
        self.hashes.append(digest.digest())
        self.times.append(min(message.time, LATEST))
        self.places.append(place)
        self.encodings.add(message.encoding)


class Recording:
    """The messages of a log.

    Args:
        messages: Function that yields the messages of all keys (None) or of the given ones, at each call.
        names: Topic and type by key, where the log says more than the key does.

    Attributes:
        tracks: Tracks by key, in the order in which the keys first occur.
        missing: Parts of the log that could not be read, or were lost during recording; a line each.
    """

    def __init__(
        self,
        name: str,
        registry: TypeRegistry,
        messages: Callable[[Collection[str] | None], Iterator[Message]],
        *,
        names: Mapping[str, tuple[str, str]] | None = None,
    ) -> None:
        self.name, self.registry = name, registry
        self.tracks: dict[str, Track] = {}
        self.count = 0
        self.missing: list[str] = []
        self.start = 0
        self._messages = messages
        self._names = names or {}
        self._file = tempfile.SpooledTemporaryFile(max_size=_IN_MEMORY)  # noqa: SIM115 - `close` does it
        self.close = weakref.finalize(self, self._file.close)
        """Discard the messages that were kept; done automatically when the recording is no longer used."""
        self._kept: dict[str, dict[int, tuple[int, int, Message]]] = {}
        for message in messages(None):
            self.start = self.start if self.count else message.time
            track = self.tracks.get(message.key) or self._open(message.key)
            track.add(message, self.count)
            self.count += 1

    def keep(self, wanted: Mapping[str, Sequence[range]]) -> None:
        """Read the log once more, so that `message` can return those at these positions, which increase, by key."""
        self._file.seek(0, 2)
        left = {key: iter(ranges) for key, ranges in wanted.items() if ranges}
        ends = {key: next(ranges) for key, ranges in left.items()}
        seen = dict.fromkeys(left, -1)
        for message in self._messages(left) if left else ():
            key = message.key
            seen[key] += 1
            while ends[key].stop <= seen[key]:
                ends[key] = next(left[key], range(1 << 62, 1 << 63))
            if seen[key] >= ends[key].start:
                spare = message.with_payload(b"")
                self._kept.setdefault(key, {})[seen[key]] = self._file.tell(), len(message.payload), spare
                self._file.write(message.payload)

    def message(self, key: str, place: int) -> Message:
        """Return a message that was kept."""
        start, size, spare = self._kept[key][place]
        self._file.seek(start)
        return spare.with_payload(self._file.read(size))

    def _open(self, key: str) -> Track:
        topic, type_name = self._names.get(key, (self.registry.topic(key), ""))
        found = self.tracks[key] = Track(key, topic, type_name, self.registry.metadata_adapter(key) is None)
        return found
