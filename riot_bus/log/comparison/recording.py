"""One side of a comparison: the messages of each topic by hash and time, and those that are looked into.

A recording is read once for what all messages are, and once more for those of which that is not enough.
"""

from __future__ import annotations

import tempfile
import weakref
from array import array
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import TYPE_CHECKING

from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from riot_bus.types.registry import TypeRegistry

__all__ = ["Recording", "Track"]

_IN_MEMORY = 1 << 26
_HASH_BYTES = 16
_LATEST = (1 << 63) - 1


@dataclass(slots=True)
class Track:
    """The messages of one topic, by their place among them.

    Attributes:
        key: Its Zenoh key.
        topic: What people call it.
        type: Name of the messages' type; empty if nothing tells.
        attachments: Whether attachments are content, not what a middleware says of itself.
        hashes: What tells messages apart, bit by bit.
        times: Reception, nanoseconds.
        places: Among all messages of the recording.
        encodings: Those that messages had.
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
        """Take in the next message."""
        digest = blake2b(message.payload, digest_size=_HASH_BYTES)
        if message.kind == "delete":
            digest.update(b"delete")
        if self.attachments and message.attachment is not None:
            digest.update(len(message.attachment).to_bytes(8, "little") + message.attachment)
        self.hashes.append(digest.digest())
        self.times.append(min(message.time, _LATEST))
        self.places.append(place)
        self.encodings.add(message.encoding)


class Recording:
    """The messages of a log.

    Args:
        name: What people call it.
        registry: Knows their types.
        messages: Yields them, each time it is called, of all keys (None) or of these.
        names: Topic and type by key, where the log says more than the key does.

    Attributes:
        tracks: By key, in the order in which they come first.
        count: How many messages there are.
        start: Time of the first one, nanoseconds.
        missing: What of the log could not be read, or was lost when it was recorded; a line each.
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
        """Forget the messages that were kept; happens by itself when the recording is no longer used."""
        self._kept: dict[str, dict[int, tuple[int, int, Message]]] = {}
        for message in messages(None):
            self.start = self.start if self.count else message.time
            track = self.tracks.get(message.key) or self._open(message.key)
            track.add(message, self.count)
            self.count += 1

    def keep(self, wanted: Mapping[str, Sequence[range]]) -> None:
        """Read once more, so that `message` can return these.

        Args:
            wanted: Places of messages, rising, by key.
        """
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
