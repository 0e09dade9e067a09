"""MessagePack payloads: a scanner finds each scalar's span of bytes, so that a patch touches nothing else.

Format: https://github.com/msgpack/msgpack/blob/master/spec.md. Extension types are not fields.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, ClassVar

from riot_bus.types.document import DocumentType, Item
from riot_bus.types.model import encoded_text, packed_float, wrap_integer
from riot_bus.vocabulary.errors import PayloadError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.types.capabilities import StandIn
    from riot_bus.vocabulary.message import Scalar

# Code -> (kind, size of the number that follows the code); the number is a count for everything but numbers.
_CODES: dict[int, tuple[str, int]] = {
    0xC0: ("nil", 0), 0xC2: ("bool", 0), 0xC3: ("bool", 0),
    0xC4: ("bin", 1), 0xC5: ("bin", 2), 0xC6: ("bin", 4), 0xC7: ("ext", 1), 0xC8: ("ext", 2), 0xC9: ("ext", 4),
    0xCA: ("float", 4), 0xCB: ("float", 8),
    0xCC: ("uint", 1), 0xCD: ("uint", 2), 0xCE: ("uint", 4), 0xCF: ("uint", 8),
    0xD0: ("int", 1), 0xD1: ("int", 2), 0xD2: ("int", 4), 0xD3: ("int", 8),
    0xD9: ("str", 1), 0xDA: ("str", 2), 0xDB: ("str", 4),
    0xDC: ("array", 2), 0xDD: ("array", 4), 0xDE: ("map", 2), 0xDF: ("map", 4),
}  # fmt: skip
_FIXEXT = {0xD4: 1, 0xD5: 2, 0xD6: 4, 0xD7: 8, 0xD8: 16}


def _whole_size(code: int) -> int:
    """Return the size of an item in bytes if its first byte determines it, otherwise 0."""
    if 0xA0 <= code < 0xC0:
        return 1 + (code & 31)
    kind, size = _CODES.get(code, ("fixint" if code < 0x80 or code >= 0xE0 else "", 0))
    return 1 + size if kind in ("nil", "bool", "uint", "int", "float", "fixint") else 0


_SIZES = tuple(map(_whole_size, range(256)))


class MsgpackType(DocumentType):
    """Every MessagePack document: the payload describes itself."""

    name = "msgpack"
    encoding = "msgpack"
    title = "MessagePack"
    stand_ins: ClassVar[Mapping[StandIn, bytes]] = {"null": b"\xc0", "list": b"\x90", "map": b"\x80"}

    def head(self, payload: bytes, at: int) -> Item:
        """Return the item that begins here."""
        return _head(payload, at)

    def skip(self, payload: bytes, at: int) -> int:
        """Return where the item that begins here ends."""
        return _skip(payload, at)

    def key(self, payload: bytes, at: int) -> tuple[str | int | None, int]:
        """Return the key of a map's entry and where its value begins, with a fast path for keys of short text."""
        code = payload[at] if at < len(payload) else 0
        end = at + 1 + (code & 31)
        if 0xA0 <= code < 0xC0 and end <= len(payload):
            return payload[at + 1 : end].decode(errors="surrogateescape"), end
        return super().key(payload, at)

    def value(self, payload: bytes, item: Item) -> Scalar | None:
        """Return a scalar's value, with surrogates for invalid UTF-8."""
        code = payload[item.start]
        data = payload[item.body : item.end]
        match item.kind:
            case "bool":
                return code == 0xC3
            case "uint":
                return int.from_bytes(data, "big") if data else code
            case "int":
                return int.from_bytes(data, "big", signed=True) if data else code - 0x100
            case "float":
                return float(struct.unpack(">f" if code == 0xCA else ">d", data)[0])
            case "str":
                return data.decode(errors="surrogateescape")
            case "bin":
                return data
        return None

    def leaf_type(self, payload: bytes, item: Item, value: Scalar) -> str:
        """Return the type of a scalar."""
        if item.kind == "float":
            return "float32" if payload[item.start] == 0xCA else "float64"
        if isinstance(value, int) and item.kind != "bool":
            return "uint64" if value >> 63 > 0 else "int64"
        return {"bool": "bool", "str": "string", "bin": "bytes"}[item.kind]

    def encode(self, payload: bytes, item: Item, value: Scalar, path: str) -> bytes:
        """Return the item that replaces a scalar."""
        code = payload[item.start]
        if isinstance(value, bool):
            return b"\xc3" if value else b"\xc2"
        if isinstance(value, int) and item.kind != "float":
            return _integer(code, item.kind, value)
        if isinstance(value, int | float):
            form, code = (">f", 0xCA) if code == 0xCA else (">d", 0xCB)
            return bytes([code]) + packed_float(form, value)
        return _sized(code, "str", encoded_text(value, path)) if isinstance(value, str) else _sized(code, "bin", value)

    def container_head(self, payload: bytes, item: Item, count: int) -> bytes:
        """Return the head of an array or map, with a count as wide as before where it fits."""
        short, wide = (0x90, 0xDC) if item.kind == "array" else (0x80, 0xDE)
        size = item.body - item.start - 1
        if not size and count < 16:
            return bytes([short | count])
        size = 2 if size < 4 and count < 1 << 16 else 4
        return bytes([wide if size == 2 else wide + 1]) + count.to_bytes(size, "big")


def is_container(payload: bytes) -> bool:
    """Return whether the payload is exactly one non-empty MessagePack map or array."""
    try:
        return _head(payload, 0).entries > 0 and _skip(payload, 0) == len(payload)
    except PayloadError:
        return False


def _head(payload: bytes, at: int) -> Item:
    try:
        code = payload[at]
        if code < 0x80 or code >= 0xE0:
            return Item("int" if code >= 0xE0 else "uint", at, at + 1, at + 1)
        if code < 0x90:
            return Item("map", at, at + 1, at + 1, code & 15)
        if code < 0xA0:
            return Item("array", at, at + 1, at + 1, code & 15)
        if code < 0xC0:
            return _checked(payload, Item("str", at, at + 1, at + 1 + (code & 31)))
        if code in _FIXEXT:
            return _checked(payload, Item("ext", at, at + 2, at + 2 + _FIXEXT[code]))
        kind, size = _CODES[code]
    except (IndexError, KeyError) as error:
        raise PayloadError(f"no valid MessagePack item at byte {at} of {len(payload)}") from error
    body = at + 1 + size
    if kind in ("nil", "bool", "uint", "int", "float"):
        return _checked(payload, Item(kind, at, at + 1, body))
    count = int.from_bytes(payload[at + 1 : body], "big")
    if kind in ("map", "array"):
        return _checked(payload, Item(kind, at, body, body, count))
    return _checked(payload, Item(kind, at, body, body + count + (kind == "ext")))


def _checked(payload: bytes, item: Item) -> Item:
    if item.end > len(payload):
        raise PayloadError(f"MessagePack item at byte {item.start} ends beyond the payload of {len(payload)} bytes")
    return item


def _skip(payload: bytes, at: int) -> int:
    """Return where the item ends, with everything in it."""
    size = _SIZES[payload[at]] if at < len(payload) else 0
    if size and at + size <= len(payload):
        return at + size
    pending = 1
    while pending:
        size = _SIZES[payload[at]] if at < len(payload) else 0
        if size:
            at += size
            pending -= 1
        else:
            kind, _, _, at, entries = _head(payload, at)
            pending += (2 * entries if kind == "map" else entries) - 1
    if at > len(payload):
        raise PayloadError(f"MessagePack ends beyond the payload of {len(payload)} bytes")
    return at


def _integer(code: int, kind: str, value: int) -> bytes:
    if not -(1 << 63) <= value < 1 << 64:
        value = wrap_integer(value, bits=64, signed=value < 0)
    old_size = _CODES[code][1] if kind in ("uint", "int") and code in _CODES else 0
    if not old_size and -32 <= value < 128:
        return value.to_bytes(1, "big", signed=value < 0)
    signed = value < 0 or (kind == "int" and old_size > 0 and value < 1 << 63)
    for new_code, (new_kind, size) in _CODES.items():
        if new_kind == ("int" if signed else "uint") and size >= old_size:
            half = 1 << (8 * size - signed)
            if (-half if signed else 0) <= value < half:
                return bytes([new_code]) + value.to_bytes(size, "big", signed=signed)
    raise AssertionError(value)


def _sized(code: int, kind: str, data: bytes) -> bytes:
    """Return a string or binary whose count is as wide as in the old head, if it fits."""
    old_kind, old_size = _CODES.get(code, ("str", 0))
    if kind == "str" and len(data) < 32 and not (old_kind == "str" and old_size):
        return bytes([0xA0 | len(data)]) + data
    for new_code, (new_kind, size) in _CODES.items():
        if new_kind == kind and len(data) < 1 << (8 * size) and (old_kind != kind or size >= old_size):
            return bytes([new_code]) + len(data).to_bytes(size, "big") + data
    raise PayloadError(f"{len(data)} bytes are too many for MessagePack")
