"""A cache of results that depend only on a payload and its type."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from hashlib import blake2b
from typing import Generic, TypeVar

from riot_bus.types.model import Leaf, MessageType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Message

_T = TypeVar("_T")


class ByPayload(Generic[_T]):
    """Caches results by payload, since different trials have nearly the same messages."""

    def __init__(self, make: Callable[[MessageType | None, bytes], _T], *, most: int = 1 << 12) -> None:
        self._make, self._most = make, most
        self._known: dict[tuple[int, bytes], tuple[MessageType | None, _T]] = {}

    def __call__(self, message: Message, registry: TypeRegistry) -> _T:
        """Return the result for a message's payload."""
        kind = registry.type_of_message(message)
        return self.of(kind, message.payload)

    def of(self, kind: MessageType | None, payload: bytes) -> _T:
        """Return the result for a payload of a type."""
        key = id(kind), blake2b(payload, digest_size=16).digest()
        known = self._known.get(key)
        if known is None:
            known = kind, self._make(kind, payload)  # keeping the type keeps its identity unique
            if len(self._known) >= self._most:
                self._known.clear()
            self._known[key] = known
        return known[1]


def _leaves(kind: MessageType | None, payload: bytes) -> Sequence[Leaf]:
    try:
        return () if kind is None else kind.leaves(payload)
    except PayloadError:
        return ()


decoded: ByPayload[Sequence[Leaf]] = ByPayload(_leaves, most=1 << 10)  # the outputs of a few trials; a guess
"""The fields of a message, with as many elements of arrays as `leaves` gives; none if it cannot be decoded."""
