"""Payloads that describe themselves in binary items: MessagePack and CBOR, walked in place.

A scanner finds each scalar's span of bytes, so that a patch touches nothing else. Integer map keys are written `[3]`.
Entries whose keys are neither strings nor integers, nil, and items without a scalar value are not fields. The last of
duplicate keys counts; a payload that is not a map is called `value`.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, NamedTuple

from riot_bus.types.capabilities import StandIn
from riot_bus.types.model import (
    MAX_DEPTH,
    REBUILD,
    ROOT,
    Leaf,
    Schema,
    check_leaves,
    check_size,
    encoded_text,
    member_path,
    packed_float,
    parse_path,
    rebuilt,
    saturated,
    why_opaque,
    wrap_integer,
)
from riot_bus.vocabulary.errors import PayloadError, did_you_mean
from riot_bus.vocabulary.message import Scalar

_MOST_TAGS = 16  # a value has one or two; hostile payloads may repeat them up to their end

_BREAK = b"\xff"
_ELEMENT, _KEY, _VALUE = range(-3, 0)
_NEXT = {_ELEMENT: _ELEMENT, _KEY: _VALUE, _VALUE: _KEY}
"""Next state after an element, a key or a value, in containers that end with a break."""
_FLOATS = {2: ">e", 4: ">f", 8: ">d"}
_PLAIN = frozenset({"bool", "float", "int", "nil", "simple", "uint"})


class Code(NamedTuple):
    """Meaning of the first byte of an item.

    Attributes:
        kind: bool, float, int (negative, or signed), uint, str, bin, array, map, nil, simple (another item without
            contents), ext (one byte and then that many) or tag (before an item); empty if no item begins with the byte.
        width: Size of the number after the byte: the value, or the number of bytes or entries.
        number: That number if the width is 0; `INDEFINITE` if a break ends the item.
    """

    kind: str
    width: int = 0
    number: int = 0


INDEFINITE = -1
_NONE = Code("")


class Item(NamedTuple):
    """An item whose head is at `start`: a scalar from `body` to `end`, or a container with `entries` from `body`."""

    kind: str
    start: int
    body: int
    end: int
    entries: int = 0


class DocumentType:
    """A `MessageType` for all documents of one encoding; subclasses define its codes.

    Attributes:
        signed: Whether codes of the kind `int` are followed by two's complement, not by -1 - value.
    """

    name = ""
    encoding = ""
    title = ""
    codes: ClassVar[Sequence[Code]]
    signed: ClassVar[bool]
    stand_ins: ClassVar[Mapping[StandIn, bytes]] = {}
    schema: Schema | None = None
    _sizes: ClassVar[Sequence[int]]
    _texts: ClassVar[Sequence[int]]
    _short: ClassVar[Mapping[tuple[str, int], int]]
    _wide: ClassVar[Mapping[str, Sequence[tuple[int, int]]]]

    def __init_subclass__(cls) -> None:
        """Derive from the codes: sizes that the first byte tells alone, and the codes by kind and number, or width."""
        definite = [code if code.number != INDEFINITE or code.kind == "int" else _NONE for code in cls.codes]
        cls._texts = [1 + code.number if code.kind == "str" and not code.width else 0 for code in definite]
        cls._sizes = [
            1 + code.width if code.kind in _PLAIN else text for code, text in zip(definite, cls._texts, strict=True)
        ]
        cls._short = {(code.kind, code.number): byte for byte, code in enumerate(definite) if not code.width}
        wide: dict[str, list[tuple[int, int]]] = {}
        for byte, code in enumerate(definite):
            if code.width:
                wide.setdefault(code.kind, []).append((code.width, byte))
        cls._wide = wide

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
            splices[item.start, item.end] = self._encoded(payload, item, value, path)
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
        head = self._resized_head(payload, parent, parent.entries - 1)
        return payload[: parent.start] + head + payload[parent.body : begin] + payload[end:]

    def head(self, payload: bytes, at: int) -> Item:
        """Return the item that begins here, without its tags; raise PayloadError if there is none."""
        for _ in range(_MOST_TAGS):
            kind, width, number = self.codes[payload[at]] if at < len(payload) else _NONE
            body = at + 1 + width
            if not kind or body > len(payload):
                break
            if kind in _PLAIN:
                return Item(kind, at, at + 1, body)
            if kind == "tag":
                at = body
                continue
            if width:
                number = int.from_bytes(payload[at + 1 : body], "big")
            if kind in ("array", "map"):
                entries = number if number != INDEFINITE else self._entries(payload, body, kind)
                return Item(kind, at, body, body, entries)
            end = body + number + (kind == "ext") if number != INDEFINITE else self.skip(payload, at)
            if end > len(payload):
                break
            return Item(kind, at, body, end)
        raise PayloadError(f"no complete {self.title} item at byte {at} of {len(payload)}")

    def skip(self, payload: bytes, at: int) -> int:
        """Return where the item that begins here ends, contents included; raise PayloadError if it is incomplete.

        `left` items are left in containers whose number of entries is known; `outer` has what is left around them, and
        the state of each container that ends with a break.
        """
        sizes, length = self._sizes, len(payload)
        size = sizes[payload[at]] if at < length else 0
        if size and at + size <= length:
            return at + size
        left, outer = 1, []
        while True:
            while left > 0:
                size = sizes[payload[at]] if at < length else 0
                left -= 1
                if size:
                    at += size
                    continue
                kind, width, number = self.codes[payload[at]] if at < length else _NONE
                if not kind:
                    raise PayloadError(f"no {self.title} item begins at byte {at} of {length}")
                if width:
                    number = int.from_bytes(payload[at + 1 : at + 1 + width], "big")
                at += 1 + width
                if kind == "tag":
                    left += 1
                elif kind in ("array", "map"):
                    if number == INDEFINITE:
                        outer += [left, _ELEMENT if kind == "array" else _KEY]
                        break
                    left += number << (kind == "map")
                else:
                    at = at + number + (kind == "ext") if number != INDEFINITE else self._parts(payload, at, kind)[1]
            if not outer:
                break
            if len(outer) > 2 * MAX_DEPTH:
                raise PayloadError(f"{self.title} is nested deeper than {MAX_DEPTH}")
            left = outer.pop()
            if left in (_ELEMENT, _KEY) and payload[at : at + 1] == _BREAK:
                at, left = at + 1, 0
            elif left < 0:
                outer.append(_NEXT[left])
                left = 1
        if at > length:
            raise PayloadError(f"{self.title} ends beyond the payload of {length} bytes")
        return at

    def key(self, payload: bytes, at: int) -> tuple[str | int | None, int]:
        """Return the key of a map's entry, None if it is neither string nor integer, and where its value begins."""
        size = self._texts[payload[at]] if at < len(payload) else 0
        if size and at + size <= len(payload):
            return payload[at + 1 : at + size].decode(errors="surrogateescape"), at + size
        item = self.head(payload, at)
        value = self.value(payload, item) if item.kind in ("str", "int", "uint") else None
        return (value if isinstance(value, str | int) else None), self.skip(payload, at)

    def value(self, payload: bytes, item: Item) -> Scalar | None:
        """Return a scalar's value, None if the item is not a scalar.

        Text has surrogates for invalid UTF-8; an integer below the int64 range is a float.
        """
        kind, width, number = self.codes[payload[item.start]]
        data = payload[item.body : item.end]
        match kind:
            case "bool":
                return bool(number)
            case "uint":
                return int.from_bytes(data, "big") if width else number
            case "int" if width:
                value = int.from_bytes(data, "big", signed=self.signed)
                value = value if self.signed else ~value
                return value if value >= -(1 << 63) else float(value)
            case "int":
                return number
            case "float":
                return float(struct.unpack(_FLOATS[width], data)[0])
            case "str" | "bin":
                data = self._parts(payload, item.body, kind)[0] if number == INDEFINITE else data
                return data.decode(errors="surrogateescape") if kind == "str" else data
        return None

    def _leaf_type(self, payload: bytes, item: Item, value: Scalar) -> str:
        """Return the type of a scalar; half and single precision are both float32."""
        if isinstance(value, float):
            return "float64" if item.kind == "int" or self.codes[payload[item.start]].width == 8 else "float32"
        if isinstance(value, int) and item.kind != "bool":
            return "uint64" if value >> 63 > 0 else "int64"
        return {"bool": "bool", "str": "string", "bin": "bytes"}[item.kind]

    def _encoded(self, payload: bytes, item: Item, value: Scalar, path: str) -> bytes:
        """Return the item that replaces a scalar, at least as wide if it is of the same kind."""
        kind, width, _ = self.codes[payload[item.start]]
        if isinstance(value, bool):
            return bytes([self._short["bool", value]])
        if isinstance(value, int) and kind != "float":
            width = width if kind in ("int", "uint") else 0
            if not -(1 << 63) <= value < 1 << 64:
                value = wrap_integer(value, bits=64, signed=value < 0)
            signed = value < 0 or (self.signed and kind == "int" and width > 0 and value < 1 << 63)
            return self._head("int" if signed else "uint", value, width)
        if isinstance(value, int | float):
            return self._float(width if kind == "float" else 8, saturated(value))
        new, data = ("str", encoded_text(value, path)) if isinstance(value, str) else ("bin", value)
        return self._head(new, len(data), width if kind == new else 0) + data

    def _float(self, width: int, number: float) -> bytes:
        """Return a number of so many bytes; half precision only if nothing is lost."""
        data = packed_float(_FLOATS[width], number)
        if width == 2 and number == number and struct.unpack(_FLOATS[width], data)[0] != number:
            return self._float(4, number)
        return bytes([dict(self._wide["float"])[width]]) + data

    def _head(self, kind: str, number: int, width: int) -> bytes:
        """Return a head whose number takes at least `width` bytes; with width 0, it may be part of the code."""
        code = None if width else self._short.get((kind, number))
        if code is not None:
            return bytes([code])
        signed = self.signed and kind == "int"
        bits = (~number if number < 0 else number).bit_length() + signed
        for size, code in self._wide[kind]:
            if size >= width and bits <= 8 * size:
                number = number if signed or number >= 0 else ~number
                return bytes([code]) + number.to_bytes(size, "big", signed=signed)
        raise PayloadError(f"{number} is too much for one {self.title} item")

    def _resized_head(self, payload: bytes, item: Item, count: int) -> bytes:
        """Return the head of an array or map with another number of entries, as wide as before where it fits."""
        if self.codes[payload[item.start]].number == INDEFINITE:
            return payload[item.start : item.body]
        return self._head(item.kind, count, item.body - item.start - 1)

    def _entries(self, payload: bytes, at: int, kind: str) -> int:
        """Return the number of entries before the break."""
        number = 0
        while payload[at : at + 1] != _BREAK:
            at = self.skip(payload, at)
            number += 1
        if kind == "map" and number % 2:
            raise PayloadError(f"{self.title} map ends after a key at byte {at}")
        return number >> (kind == "map")

    def _parts(self, payload: bytes, at: int, kind: str) -> tuple[bytes, int]:
        """Return a string whose parts begin here and end with a break, and where it ends."""
        parts = []
        while payload[at : at + 1] != _BREAK:
            code = self.codes[payload[at]] if at < len(payload) else _NONE
            if code.kind != kind or code.number == INDEFINITE:
                raise PayloadError(f"byte {at} does not begin a part of a {self.title} string")
            _, _, body, at, _ = self.head(payload, at)
            parts.append(payload[body:at])
        return b"".join(parts), at + 1

    def _collect(self, payload: bytes, item: Item, path: str, elements: int, depth: int, found: list[Leaf]) -> None:
        if depth > MAX_DEPTH:
            raise PayloadError(f"{self.title} is nested deeper than {MAX_DEPTH}")
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
            found.append(Leaf(path, self._leaf_type(payload, item, value), value))

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
        return payload[: item.start] + self._resized_head(payload, item, count) + content + payload[rest:]
