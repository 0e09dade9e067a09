"""Facts about topics from a short recording: message rates, and the codecs that read all payloads."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.plugins import CODECS
from riot_bus.types.model import ROOT, MessageType
from riot_bus.types.raw_type import OpaqueType
from riot_bus.vocabulary.errors import PayloadError, RiotError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

_MOST_READ, _LARGEST_READ = 200, 1 << 20
"""Largest number of payloads read for each topic, and their largest size: a few show which codecs fit."""
_MOST_ENCODINGS = 8  # publishers may use any text as encoding; usually, a topic has one or two
_TEXT = "json"
_MOST_TOPICS = 2000  # drafts are for people to edit; the memory stays bounded if keys are invented


@dataclass(frozen=True, slots=True)
class TopicDraft:
    """Known facts about a topic.

    Attributes:
        topic: Name of the topic.
        key: Zenoh key of the topic.
        type_name: Its type; empty if unknown.
        declare: Whether riot.toml has to declare the type, since keys, encodings and payloads do not identify it.
        fits: Codecs that read all payloads, if it is not clear which of them is right.
        encodings: Encodings of its messages, the most frequent first.
        count: Number of its messages.
        rate: Messages per second.
        sizes: Sizes of the smallest and the largest payload, in bytes.
        read: Number of payloads that were read.
    """

    topic: str
    key: str
    type_name: str = ""
    declare: bool = False
    fits: tuple[str, ...] = ()
    encodings: tuple[str, ...] = ()
    count: int = 0
    rate: float = 0.0
    sizes: tuple[int, int] = (0, 0)
    read: int = 0


class TopicLook:
    """The messages of one key.

    Args:
        key: Zenoh key of the messages.
        registry: Registry of message types.
        codecs: Codecs for self-describing documents.
    """

    def __init__(self, key: str, registry: TypeRegistry, codecs: Sequence[MessageType]) -> None:
        self._key, self._registry = key, registry
        self._told: MessageType | None = None
        self._readable, self._read, self._count = True, 0, 0
        self._fitting = {each.name: each for each in codecs}
        self._documents: set[str] = set()
        self._encodings = Counter[str]()
        self._first = self._last = self._least = self._most = 0

    def add(self, message: Message) -> None:
        """Add a message."""
        size = len(message.payload)
        if not self._count:
            self._first, self._least = message.time, size
        self._count += 1
        self._last, self._least, self._most = message.time, min(self._least, size), max(self._most, size)
        if message.encoding in self._encodings or len(self._encodings) < _MOST_ENCODINGS:
            self._encodings[message.encoding] += 1
        if message.kind == "put" and self._read < _MOST_READ and size <= _LARGEST_READ:
            self._read += 1
            self._try(message)

    def _try(self, message: Message) -> None:
        payload = message.payload
        self._told = self._registry.type_of(self._key, payload=payload, encoding=message.encoding)
        self._readable = self._readable and self._told is not None and self._told.opaque(payload) is None
        for name, codec in list(self._fitting.items()):
            try:
                leaves = codec.leaves(payload, elements=1)
            except PayloadError:
                del self._fitting[name]
                continue
            if leaves and leaves[0].path != ROOT:
                self._documents.add(name)

    def draft(self) -> TopicDraft:
        """Return what is known about the topic."""
        fits = tuple(self._fitting) if self._read else ()
        # A few bytes are a valid number in any binary encoding, so only text is recognised without a document.
        clear = [name for name in fits if name in self._documents] or [name for name in fits if fits == (_TEXT,)]
        told = self._told.name if self._told is not None and self._readable else ""
        seconds = (self._last - self._first) / 1e9
        return TopicDraft(
            self._registry.topic(self._key),
            self._key,
            told or (clear[0] if len(clear) == 1 else ""),
            declare=not told and len(clear) == 1,
            fits=fits if not told and len(clear) != 1 else (),
            encodings=tuple(name for name, _ in self._encodings.most_common()),
            count=self._count,
            rate=(self._count - 1) / seconds if seconds > 0 else 0.0,
            sizes=(self._least, self._most),
            read=self._read,
        )


def look_at(messages: Iterable[Message], registry: TypeRegistry) -> tuple[dict[str, TopicDraft], int]:
    """Return what messages show about their topics, by key, and the number of keys skipped because of the limit.

    Args:
        messages: Messages in their order.
        registry: Registry of message types, which already knows the schemas of logs.
    """
    codecs = _documents(registry)
    looks: dict[str, TopicLook] = {}
    skipped: set[str] = set()
    for message in messages:
        if message.key not in looks:
            if len(looks) >= _MOST_TOPICS:
                skipped.add(message.key)
                continue
            looks[message.key] = TopicLook(message.key, registry, codecs)
        looks[message.key].add(message)
    return {key: looks[key].draft() for key in sorted(looks)}, len(skipped)


def _documents(registry: TypeRegistry) -> list[MessageType]:
    """Return the codecs whose payloads need no definition, without those that cannot be loaded."""
    found: list[MessageType | None] = []
    for name in CODECS.targets():
        with suppress(RiotError):
            found.append(registry.type_named(name))
    return [each for each in found if each is not None and not isinstance(each, OpaqueType)]
