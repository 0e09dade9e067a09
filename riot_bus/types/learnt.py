"""Types of fields of formats without a definition, learnt from a log: whoever writes 1.0 as 1 has a float.

All elements of an array have one type, and so has a field over the whole log.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from riot_bus.types.capabilities import OmitsFields, StandIn
from riot_bus.types.model import Leaf, MessageType, Schema, family_of
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Message, Scalar

_INTEGERS, _FLOATS = frozenset({"int64", "uint64"}), frozenset({"float32", "float64"})


class LearntType:
    """A self-describing type of which some fields are floats, also where a payload has them as integers.

    Args:
        floats: Paths of these fields, with `[*]` for each index.
    """

    def __init__(self, kind: MessageType, floats: frozenset[str]) -> None:
        self._kind, self._floats = kind, floats
        self.name, self.encoding = kind.name, kind.encoding
        self.schema: Schema | None = kind.schema

    def leaves(self, payload: bytes, *, elements: int = 16) -> Sequence[Leaf]:
        """List the scalar fields in payload order."""
        return [
            Leaf(leaf.path, "float64", float(leaf.value)) if self._is_float(leaf.path, leaf.type) else leaf
            for leaf in self._kind.leaves(payload, elements=elements)
        ]

    def opaque(self, payload: bytes) -> str | None:
        """Return why the payload cannot be decoded, None if it can."""
        return self._kind.opaque(payload)

    def read(self, payload: bytes, path: str) -> Scalar:
        """Return one field's value (`len(path)` for the length of an array)."""
        value = self._kind.read(payload, path)
        is_integer = isinstance(value, int) and not isinstance(value, bool)
        return float(value) if is_integer and family_of(path) in self._floats else value

    def patch(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with some scalars replaced."""
        return self._kind.patch(payload, changes)

    def rebuild(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with scalars and lengths of arrays changed."""
        return self._kind.rebuild(payload, changes)

    def omit(self, payload: bytes, path: str, *, instead: StandIn | None = None) -> bytes:
        """Return the payload without a field of a map, or with a replacement for it."""
        assert isinstance(self._kind, OmitsFields)
        return self._kind.omit(payload, path, instead=instead)

    def _is_float(self, path: str, type_name: str) -> bool:
        return type_name in _INTEGERS and family_of(path) in self._floats


def learn_types(messages: Iterable[Message], registry: TypeRegistry) -> None:
    """Let a registry know the types that the fields of a log's self-describing messages have, by key."""
    seen: dict[str, tuple[MessageType, dict[str, set[str]]]] = {}
    for message in messages:
        kind = registry.type_of_message(message)
        if kind is None or not isinstance(kind, OmitsFields):
            continue
        known, families = seen.setdefault(message.key, (kind, {}))
        for leaf in _leaves(kind, message.payload) if kind is known else ():
            families.setdefault(family_of(leaf.path), set()).add(leaf.type)
    for key, (kind, families) in seen.items():
        floats = {family for family, names in families.items() if names & _INTEGERS and names & _FLOATS}
        if floats:
            registry.refine(key, LearntType(kind, frozenset(floats)))


def _leaves(kind: MessageType, payload: bytes) -> Sequence[Leaf]:
    """Return the fields of a payload; none if it cannot be read."""
    try:
        return kind.leaves(payload)
    except PayloadError:
        return ()
