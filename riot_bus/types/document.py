"""Payloads that describe themselves in binary items: MessagePack and CBOR, walked in place.

Integer map keys are written `[3]`. Entries whose keys are neither strings nor integers, nil, and items without a scalar
value are not fields. The last of duplicate keys counts; a payload that is not a map is called `value`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from riot_bus.types.model import (
    REBUILD,
    ROOT,
    Leaf,
    Schema,
    check_leaves,
    check_size,
    member_path,
    parse_path,
    rebuilt,
    why_opaque,
)
from riot_bus.vocabulary.errors import PayloadError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from riot_bus.types.capabilities import StandIn
    from riot_bus.vocabulary.message import Scalar

_MAX_DEPTH = 64  # one call for each level: far below Python's limit of 1000; as for JSON


class Item(NamedTuple):
    """An item whose head is at `start`: a scalar from `body` to `end`, or a container with `entries` from `body`."""

    kind: str
    start: int
    body: int
    end: int
    entries: int = 0


class DocumentType(ABC):
    """A `MessageType` for all documents of one encoding; subclasses define how items are encoded.

    Attributes:
        title: Name of the encoding for users.
        stand_ins: Encoded replacements of fields.
    """

    name = ""
    encoding = ""
    title = ""
    stand_ins: ClassVar[Mapping[StandIn, bytes]] = {}
    schema: Schema | None = None

    def leaves(self, payload: bytes, *, elements: int = 16) -> Sequence[Leaf]:
        """List the scalar fields in payload order."""
        root = self.head(payload, 0)
        if self.skip(payload, 0) != len(payload):
            raise PayloadError(f"bytes follow the {self.title} document")
        found: list[Leaf] = []
        self._collect(payload, root, "" if root.kind == "map" else ROOT, elements, 0, found)
        return found

    def opaque(self, payload: bytes) -> str | None:
        """Return why the payload cannot be decoded, None if it can."""
        return why_opaque(self, payload)

    def read(self, payload: bytes, path: str) -> Scalar:
        """Return one field's value (`len(path)` for the length of an array)."""
        item = self._find(payload, path)
        if parse_path(path).length:
            if item.kind != "array":
                raise PayloadError("only arrays have a length", where=path)
            self.skip(payload, item.start)
            return item.entries
        value = self.value(payload, item)
        if value is None:
            raise PayloadError(f"{item.kind} is not a scalar field", where=path)
        return value

    def patch(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with some scalars replaced; every byte outside of them stays as it is.

        Numbers keep their format if the new value fits, otherwise they get the next wider one; integers of more than 64
        bits wrap. A float may be written into an integer field, since encoders shorten 1.0 to 1.
        """
        splices: dict[tuple[int, int], bytes] = {}
        for path, value in changes.items():
            if parse_path(path).length:
                raise PayloadError("a length cannot be patched in place", where=path, hint=REBUILD)
            item = self._find(payload, path)
            if self.value(payload, item) is None:
                raise PayloadError(f"{item.kind} is not a scalar field", where=path)
            splices[item.start, item.end] = self.encode(payload, item, value, path)
        for (start, end), data in sorted(splices.items(), reverse=True):
            payload = payload[:start] + data + payload[end:]
        return payload

    def rebuild(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with scalars and lengths of arrays changed; an empty array cannot grow."""
        return rebuilt(payload, changes, self._resized, self.patch)

    def omit(self, payload: bytes, path: str, *, instead: StandIn | None = None) -> bytes:
        """Return the payload without a field of a map, or with a replacement for it."""
        item = self._find(payload, path)
        if parse_path(path).length:
            raise PayloadError("a length cannot be left out", where=path)
        if instead:
            return payload[: item.start] + self.stand_ins[instead] + payload[self.skip(payload, item.start) :]
        *outer, step = parse_path(path).steps
        parent = self._at(payload, tuple(outer), path)
        if parent.kind != "map":
            raise PayloadError("only entries of a map can be left out", where=path)
        at = parent.body
        begin = end = at
        for _ in range(parent.entries):
            key, value = self.key(payload, at)
            if key == step:
                begin, end = at, self.skip(payload, value)
            at = self.skip(payload, value)
        head = self.container_head(payload, parent, parent.entries - 1)
        return payload[: parent.start] + head + payload[parent.body : begin] + payload[end:]

    @abstractmethod
    def head(self, payload: bytes, at: int) -> Item:
        """Return the item that begins here; raise PayloadError if there is none."""

    @abstractmethod
    def skip(self, payload: bytes, at: int) -> int:
        """Return where the item that begins here ends, contents included; raise PayloadError if it is incomplete."""

    @abstractmethod
    def value(self, payload: bytes, item: Item) -> Scalar | None:
        """Return a scalar's value, None if the item is not a scalar."""

    @abstractmethod
    def leaf_type(self, payload: bytes, item: Item, value: Scalar) -> str:
        """Return the type of a scalar."""

    @abstractmethod
    def encode(self, payload: bytes, item: Item, value: Scalar, path: str) -> bytes:
        """Return the item that replaces a scalar."""

    @abstractmethod
    def container_head(self, payload: bytes, item: Item, count: int) -> bytes:
        """Return the head of an array or map with another number of entries."""

    def key(self, payload: bytes, at: int) -> tuple[str | int | None, int]:
        """Return the key of a map's entry, None if it is neither string nor integer, and where its value begins."""
        item = self.head(payload, at)
        value = self.value(payload, item) if item.kind in ("str", "int", "uint") else None
        return (value if isinstance(value, str | int) else None), self.skip(payload, at)

    def _collect(self, payload: bytes, item: Item, path: str, elements: int, depth: int, found: list[Leaf]) -> None:
        if depth > _MAX_DEPTH:
            raise PayloadError(f"{self.title} is nested deeper than {_MAX_DEPTH}")
        check_leaves(len(found), elements)
        if item.kind == "map":
            for key, at in dict(self._members(payload, item)).items():
                if key is not None:
                    self._collect(payload, self.head(payload, at), member_path(path, key), elements, depth + 1, found)
        elif item.kind == "array":
            found.append(Leaf(f"len({path})", "uint32", item.entries))
            at = item.body
            for index in range(min(elements, item.entries)):
                self._collect(payload, self.head(payload, at), f"{path}[{index}]", elements, depth + 1, found)
                at = self.skip(payload, at)
        elif (value := self.value(payload, item)) is not None:
            found.append(Leaf(path, self.leaf_type(payload, item, value), value))

    def _members(self, payload: bytes, item: Item) -> Iterator[tuple[str | int | None, int]]:
        """Yield the key of each entry of a map, as `key` returns it, and where its value begins."""
        at = item.body
        for _ in range(item.entries):
            key, at = self.key(payload, at)
            yield key, at
            at = self.skip(payload, at)

    def _find(self, payload: bytes, path: str) -> Item:
        return self._at(payload, parse_path(path).steps, path)

    def _at(self, payload: bytes, steps: tuple[str | int, ...], path: str) -> Item:
        item = self.head(payload, 0)
        if item.kind != "map":
            if steps[:1] != (ROOT,):
                raise PayloadError(f"the payload is not a map; its path begins with {ROOT!r}", where=path)
            steps = steps[1:]
        for step in steps:
            if item.kind == "array" and isinstance(step, int):
                if not 0 <= step < item.entries:
                    raise PayloadError(f"no element {step} in an array of {item.entries}", where=path)
                at = item.body
                for _ in range(step):
                    at = self.skip(payload, at)
            else:
                at = self._member(payload, item, step, path)
            item = self.head(payload, at)
        return item

    def _member(self, payload: bytes, item: Item, step: str | int, path: str) -> int:
        """Return where the value of a map's entry begins."""
        at, found = item.body, 0
        for _ in range(item.entries if item.kind == "map" else 0):
            key, at = self.key(payload, at)
            if key == step:
                found = at
            at = self.skip(payload, at)
        if not found:
            known = [key for key, _ in self._members(payload, item)] if item.kind == "map" else []
            hint = did_you_mean(str(step), [key for key in known if isinstance(key, str)])
            raise PayloadError(f"no field {step!r}", where=path, hint=hint)
        return found

    def _resized(self, payload: bytes, path: str, count: int) -> bytes:
        item = self._find(payload, path)
        if item.kind != "array":
            raise PayloadError("only arrays have a length", where=path)
        last = end = item.body
        for _ in range(min(count, item.entries)):
            last, end = end, self.skip(payload, end)
        rest = end
        for _ in range(count, item.entries):
            rest = self.skip(payload, rest)
        content = payload[item.body : end]
        if count > item.entries:
            if not item.entries:
                raise PayloadError("nothing tells what the elements of an empty array are", where=path)
            check_size(len(payload) + (count - item.entries) * (end - last), path)
            content += payload[last:end] * (count - item.entries)
        return payload[: item.start] + self.container_head(payload, item, count) + content + payload[rest:]
