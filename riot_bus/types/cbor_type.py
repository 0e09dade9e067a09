"""CBOR payloads (RFC 8949): a scanner finds each scalar's span of bytes, so that a patch touches nothing else.

Tags are transparent: the field is the value that they enclose, and they are kept. Null, undefined and other simple
values are not fields. Containers and strings of indefinite length are read; a patched string gets a definite length.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, ClassVar

from riot_bus.types.document import DocumentType, Item
from riot_bus.types.model import encoded_text, packed_float, saturated, wrap_integer
from riot_bus.vocabulary.errors import PayloadError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.types.capabilities import StandIn
    from riot_bus.vocabulary.message import Scalar

_KINDS = ("uint", "int", "bin", "str", "array", "map", "tag", "simple")
_UINT, _INT, _BIN, _STR, _ARRAY, _MAP, _TAG, _SIMPLE = range(8)
_SIZES = {24: 1, 25: 2, 26: 4, 27: 8}
_INDEFINITE = 31
_ELEMENT, _KEY, _VALUE = -1, -2, -3
_NEXT = {_ELEMENT: _ELEMENT, _KEY: _VALUE, _VALUE: _KEY}
"""Next state after an element, a key or a value, in containers that end with a break."""
_MOST_OPEN = 1000  # no recursion: bounds a list for hostile payloads; `leaves` reads fewer levels anyway
_FLOATS = {0xF9: ">e", 0xFA: ">f", 0xFB: ">d"}
_FEW_TAGS = 16  # a value has one or two; hostile payloads may repeat them up to their end


def _whole_size(code: int) -> int:
    """Return the size of an item in bytes if its first byte determines it, otherwise 0."""
    major, info = code >> 5, code & 31
    if major in (_BIN, _STR):
        return 1 + info if info < 24 else 0
    if major in (_UINT, _INT, _SIMPLE):
        return 1 if info < 24 else 1 + _SIZES.get(info, -1)
    return 0


_WHOLE = tuple(map(_whole_size, range(256)))
_SHORT_TEXT, _LONG_TEXT = _STR << 5, _STR << 5 | 24


class CborType(DocumentType):
    """Every CBOR document: the payload describes itself."""

    name = "cbor"
    encoding = "cbor"
    title = "CBOR"
    stand_ins: ClassVar[Mapping[StandIn, bytes]] = {"null": b"\xf6", "list": b"\x80", "map": b"\xa0"}

    def head(self, payload: bytes, at: int) -> Item:
        """Return the item that begins here, without its tags."""
        for _ in range(_FEW_TAGS):
            major, info, body, number = _head(payload, at)
            if major != _TAG:
                return _item(payload, at, major, info, body, number)
            at = body
        raise PayloadError(f"more than {_FEW_TAGS} CBOR tags before byte {at}")

    def skip(self, payload: bytes, at: int) -> int:
        """Return where the item that begins here ends."""
        return _skip(payload, at)

    def key(self, payload: bytes, at: int) -> tuple[str | int | None, int]:
        """Return the key of a map's entry and where its value begins, with a fast path for keys of short text."""
        code = payload[at] if at < len(payload) else 0
        end = at + 1 + (code & 31)
        if _SHORT_TEXT <= code < _LONG_TEXT and end <= len(payload):
            return payload[at + 1 : end].decode(errors="surrogateescape"), end
        return super().key(payload, at)

    def value(self, payload: bytes, item: Item) -> Scalar | None:
        """Return a scalar's value, with surrogates for invalid UTF-8 and a float for integers below the int64 range."""
        code = payload[item.start]
        data = payload[item.body : item.end]
        match item.kind:
            case "bool":
                return code == 0xF5
            case "uint":
                return int.from_bytes(data, "big") if data else code & 31
            case "int":
                value = -1 - (int.from_bytes(data, "big") if data else code & 31)
                return value if value >= -(1 << 63) else float(value)
            case "float":
                return float(struct.unpack(_FLOATS[code], data)[0])
            case "str" | "bin":
                data = _chunks(payload, item) if code & 31 == _INDEFINITE else data
                return data.decode(errors="surrogateescape") if item.kind == "str" else data
        return None

    def leaf_type(self, payload: bytes, item: Item, value: Scalar) -> str:
        """Return the type of a scalar; half and single precision are both float32."""
        if isinstance(value, float):
            return "float64" if item.kind == "int" or payload[item.start] == 0xFB else "float32"
        if isinstance(value, int) and item.kind != "bool":
            return "uint64" if value >> 63 > 0 else "int64"
        return {"bool": "bool", "str": "string", "bin": "bytes"}[item.kind]

    def encode(self, payload: bytes, item: Item, value: Scalar, path: str) -> bytes:
        """Return the item that replaces a scalar."""
        code = payload[item.start]
        width = item.body - item.start - 1 if item.kind in ("str", "bin") else item.end - item.start - 1
        if isinstance(value, bool):
            return b"\xf5" if value else b"\xf4"
        if isinstance(value, int) and item.kind != "float":
            if not -(1 << 63) <= value < 1 << 64:
                value = wrap_integer(value, bits=64, signed=value < 0)
            width = width if item.kind in ("uint", "int") else 0
            return _counted(_UINT, value, width) if value >= 0 else _counted(_INT, -1 - value, width)
        if isinstance(value, int | float):
            return _float(code, value)
        data = encoded_text(value, path) if isinstance(value, str) else value
        kept = width if item.kind in ("str", "bin") and code & 31 != _INDEFINITE else 0
        return _counted(_STR if isinstance(value, str) else _BIN, len(data), kept) + data

    def container_head(self, payload: bytes, item: Item, count: int) -> bytes:
        """Return the head of an array or map, with a count as wide as before where it fits."""
        if payload[item.start] & 31 == _INDEFINITE:
            return payload[item.start : item.body]
        return _counted(_ARRAY if item.kind == "array" else _MAP, count, item.body - item.start - 1)


def _head(payload: bytes, at: int) -> tuple[int, int, int, int]:
    """Return major type, additional information, where the body begins, and the number in the head."""
    if at >= len(payload):
        raise PayloadError(f"CBOR ends at byte {at}, where an item should begin")
    major, info = payload[at] >> 5, payload[at] & 31
    if info < 24:
        return major, info, at + 1, info
    if info in _SIZES:
        body = at + 1 + _SIZES[info]
        if body > len(payload):
            raise PayloadError(f"CBOR item at byte {at} ends beyond the payload of {len(payload)} bytes")
        return major, info, body, int.from_bytes(payload[at + 1 : body], "big")
    if info == _INDEFINITE and major in (_BIN, _STR, _ARRAY, _MAP):
        return major, info, at + 1, 0
    raise PayloadError(f"no CBOR item begins at byte {at}")


def _item(payload: bytes, at: int, major: int, info: int, body: int, number: int) -> Item:
    """Return an item without tags; measure it if its length is indefinite."""
    kind = _KINDS[major]
    if major in (_UINT, _INT):
        return Item(kind, at, at + 1, body)
    if major == _SIMPLE:
        code = payload[at]
        name = "float" if code in _FLOATS else "bool" if code in (0xF4, 0xF5) else "nil" if code == 0xF6 else kind
        return Item(name, at, at + 1, body)
    if major in (_ARRAY, _MAP):
        if info == _INDEFINITE:
            number = _count(payload, body)
            if major == _MAP and number % 2:
                raise PayloadError(f"CBOR map at byte {at} ends after a key")
            number >>= major == _MAP
        return Item(kind, at, body, body, number)
    end = _skip(payload, at) if info == _INDEFINITE else body + number
    if end > len(payload):
        raise PayloadError(f"CBOR item at byte {at} ends beyond the payload of {len(payload)} bytes")
    return Item(kind, at, body, end)


def _count(payload: bytes, at: int) -> int:
    """Return the number of items before the break."""
    number = 0
    while payload[at : at + 1] != b"\xff":
        at = _skip(payload, at)
        number += 1
    return number


def _skip(payload: bytes, at: int) -> int:
    """Return where the item ends, with everything in it.

    `open_` has the number of remaining items of each open container, or a state if the container ends with a break.
    Items of definite containers are added to the count of the enclosing one, so only indefinite containers nest.
    """
    size = _WHOLE[payload[at]] if at < len(payload) else 0
    if size and at + size <= len(payload):
        return at + size
    open_ = [1]
    while True:
        left = open_[-1]
        if left == 0:
            open_.pop()
            if not open_:
                if at > len(payload):
                    raise PayloadError(f"CBOR ends beyond the payload of {len(payload)} bytes")
                return at
            continue
        if left in (_ELEMENT, _KEY) and payload[at : at + 1] == b"\xff":
            at += 1
            open_[-1] = 0
            continue
        open_[-1] = left - 1 if left > 0 else _NEXT[left]
        size = _WHOLE[payload[at]] if at < len(payload) else 0
        if size:
            at += size
            continue
        major, info, body, number = _head(payload, at)
        at = body
        if major in (_BIN, _STR):
            at = _skip_chunks(payload, body, major) if info == _INDEFINITE else body + number
            if at > len(payload):
                raise PayloadError(f"CBOR string ends beyond the payload of {len(payload)} bytes")
            continue
        if major in (_ARRAY, _MAP) and info == _INDEFINITE:
            open_.append(_ELEMENT if major == _ARRAY else _KEY)
        elif major in (_ARRAY, _MAP, _TAG):
            inside = 1 if major == _TAG else number << (major == _MAP)
            if open_[-1] >= 0:
                open_[-1] += inside
            else:
                open_.append(inside)
        if len(open_) > _MOST_OPEN:
            raise PayloadError(f"CBOR is nested deeper than {_MOST_OPEN}")


def _skip_chunks(payload: bytes, at: int, major: int) -> int:
    while payload[at : at + 1] != b"\xff":
        kind, info, body, number = _head(payload, at)
        if kind != major or info == _INDEFINITE:
            raise PayloadError(f"byte {at} does not begin a part of a CBOR string")
        at = body + number
    return at + 1


def _chunks(payload: bytes, item: Item) -> bytes:
    """Return a string of indefinite length, whose end is known."""
    parts = []
    at = item.body
    while at < item.end - 1:
        _, _, body, number = _head(payload, at)
        at = body + number
        parts.append(payload[body:at])
    return b"".join(parts)


def _counted(major: int, number: int, width: int) -> bytes:
    """Return a head whose number takes at least `width` bytes; with width 0, it may fit into the first byte."""
    if not width and number < 24:
        return bytes([major << 5 | number])
    info, size = next((info, size) for info, size in _SIZES.items() if size >= width and number < 1 << (8 * size))
    return bytes([major << 5 | info]) + number.to_bytes(size, "big")


def _float(code: int, value: float) -> bytes:
    """Return a number in the precision of the old one; half precision only if nothing is lost."""
    number = saturated(value)
    if code == 0xF9:
        half = packed_float(">e", number)
        if number != number or struct.unpack(">e", half)[0] == number:
            return b"\xf9" + half
        code = 0xFA
    code = code if code == 0xFA else 0xFB
    return bytes([code]) + packed_float(_FLOATS[code], number)
