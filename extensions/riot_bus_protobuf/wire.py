"""The wire format of Protocol Buffers: entries of a message, varints, scalars.

Source: https://protobuf.dev/programming-guides/encoding/.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Container, Iterator
from typing import NamedTuple

from riot_bus.types.model import encoded_text, packed_float, wrap_integer
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Scalar

VARINT, FIXED64, BYTES, GROUP, END_GROUP, FIXED32 = range(6)
"""Wire types; `GROUP` begins a group."""

_MOST_GROUPS = 100  # the default limit of Google's parsers for nested messages
_MAX_VARINT = 10  # 64 bits, 7 in each byte


class ScalarKind(NamedTuple):
    """A kind of scalar: its wire type, its type as in `Leaf`, and its struct format if its size is fixed."""

    wire: int
    leaf: str
    form: struct.Struct | None = None
    zigzag: bool = False

    @property
    def size(self) -> int:
        """Size of a value in bytes if it is fixed, otherwise 0."""
        return self.form.size if self.form is not None else 0


KINDS = {
    "double": ScalarKind(FIXED64, "float64", struct.Struct("<d")),
    "float": ScalarKind(FIXED32, "float32", struct.Struct("<f")),
    "int64": ScalarKind(VARINT, "int64"),
    "uint64": ScalarKind(VARINT, "uint64"),
    "int32": ScalarKind(VARINT, "int32"),
    "fixed64": ScalarKind(FIXED64, "uint64", struct.Struct("<Q")),
    "fixed32": ScalarKind(FIXED32, "uint32", struct.Struct("<I")),
    "bool": ScalarKind(VARINT, "bool"),
    "string": ScalarKind(BYTES, "string"),
    "bytes": ScalarKind(BYTES, "bytes"),
    "uint32": ScalarKind(VARINT, "uint32"),
    "enum": ScalarKind(VARINT, "int32"),
    "sfixed32": ScalarKind(FIXED32, "int32", struct.Struct("<i")),
    "sfixed64": ScalarKind(FIXED64, "int64", struct.Struct("<q")),
    "sint32": ScalarKind(VARINT, "int32", zigzag=True),
    "sint64": ScalarKind(VARINT, "int64", zigzag=True),
}
"""Kinds of scalars by their names in .proto files; enums are open."""


class WireField(NamedTuple):
    """One field on the wire.

    Attributes:
        number: Field number.
        wire: Wire type of the entry.
        start: Offset of its tag in the payload.
        value: Offset after the tag, where text, bytes, messages and packed arrays have their length prefix.
        body: Offset of the value itself.
        end: Offset of its end.
        after: Offset of the next entry; for a group, after the tag that ends it.
    """

    number: int
    wire: int
    start: int
    value: int
    body: int
    end: int
    after: int


def read_varint(data: bytes, at: int, end: int) -> tuple[int, int]:
    """Return a varint of 64 bits at most, and where it ends; raise PayloadError if it does not end."""
    if at < end and data[at] < 0x80:
        return data[at], at + 1
    number = shift = 0
    for place in range(at, min(end, at + _MAX_VARINT)):
        byte = data[place]
        number |= (byte & 0x7F) << shift
        if byte < 0x80:
            return number & 0xFFFF_FFFF_FFFF_FFFF, place + 1
        shift += 7
    raise PayloadError(f"varint at byte {at} does not end")


def varint(number: int) -> bytes:
    """Return the shortest varint of an integer that is not negative."""
    packed = bytearray()
    while number > 0x7F:
        packed.append(number & 0x7F | 0x80)
        number >>= 7
    packed.append(number)
    return bytes(packed)


def tag(number: int, wire: int) -> bytes:
    """Return the tag of an entry."""
    return varint(number << 3 | wire)


def entries(data: bytes, start: int, end: int, numbers: Container[int]) -> Iterator[WireField]:
    """Yield the entries with these field numbers of a message from `start` to `end`, and skip all others.

    Raises:
        PayloadError: An entry, wanted or not, is invalid or extends beyond `end`.
    """
    after = start
    while after < end:
        first = after
        key, value = data[first], first + 1
        if key >= 0x80:
            key, value = read_varint(data, first, end)
        number, wire = key >> 3, key & 7
        if not 0 < number < 1 << 29:
            raise PayloadError(f"no field number at byte {first}: {number}")
        if wire == GROUP:
            body = value
            stop, after = _end_of_group(data, value, end, number)
        else:
            body, stop = _span(data, value, end, wire)
            after = stop
        if number in numbers:
            yield WireField(number, wire, first, value, body, stop, after)


def _span(data: bytes, at: int, end: int, wire: int) -> tuple[int, int]:
    """Return where a value begins and ends."""
    body = at
    if wire == VARINT:
        stop = at + 1 if at < end and data[at] < 0x80 else read_varint(data, at, end)[1]
    elif wire == BYTES:
        size, body = (data[at], at + 1) if at < end and data[at] < 0x80 else read_varint(data, at, end)
        stop = body + size
    elif wire in (FIXED64, FIXED32):
        stop = at + (8 if wire == FIXED64 else 4)
    else:
        raise PayloadError(f"wire type {wire} at byte {at} begins nothing")
    if stop > end:
        raise PayloadError(f"value at byte {at} ends beyond its message, which ends at byte {end}")
    return body, stop


def _end_of_group(data: bytes, at: int, end: int, number: int) -> tuple[int, int]:
    """Return where the contents of a group end, and where its end tag ends."""
    open_ = [number]
    while at < end:
        start = at
        key, at = read_varint(data, at, end)
        if key & 7 == GROUP:
            open_.append(key >> 3)
            if len(open_) > _MOST_GROUPS:
                raise PayloadError(f"groups are nested deeper than {_MOST_GROUPS}")
        elif key & 7 == END_GROUP:
            if (opened := open_.pop()) != key >> 3:
                text = f"byte {start} ends the group of field {key >> 3}, but the open group is that of field {opened}"
                raise PayloadError(text)
            if not open_:
                return start, at
        else:
            at = _span(data, at, end, key & 7)[1]
    raise PayloadError(f"group {number} does not end")


def decode(kind: ScalarKind, data: bytes, body: int, end: int) -> Scalar:
    """Return a value, with surrogates for invalid UTF-8 and integers truncated to the bits of their type."""
    if kind.form is not None:
        value: Scalar = kind.form.unpack_from(data, body)[0]
        return value
    if kind.wire == BYTES:
        return data[body:end].decode(errors="surrogateescape") if kind.leaf == "string" else data[body:end]
    number = read_varint(data, body, end)[0]
    if kind.leaf == "bool":
        return number != 0
    bits = _bits(kind)
    if kind.zigzag:
        number &= (1 << bits) - 1
        return number >> 1 ^ -(number & 1)
    return wrap_integer(number, bits=bits, signed=kind.leaf[0] == "i")


def encode(kind: ScalarKind, value: Scalar) -> bytes:
    """Return an encoded value without length prefix; integers wrap, floats that overflow become infinite.

    Raises:
        PayloadError: The value is of another kind.
    """
    if kind.wire == BYTES:
        return _text(kind, value)
    if isinstance(value, str | bytes):
        raise PayloadError(f"{value!r} is not of type {kind.leaf}")
    if kind.leaf.startswith("float"):
        return packed_float("<f" if kind.leaf == "float32" else "<d", value)
    if isinstance(value, float) and not math.isfinite(value):
        raise PayloadError(f"{value} is not of type {kind.leaf}")
    if kind.leaf == "bool":
        return b"\1" if value else b"\0"
    number = wrap_integer(int(value), bits=_bits(kind), signed=kind.leaf[0] == "i")
    if kind.form is not None:
        return kind.form.pack(number)
    if kind.zigzag:
        return varint(number << 1 if number >= 0 else (-number << 1) - 1)
    return varint(number & 0xFFFF_FFFF_FFFF_FFFF)


def _text(kind: ScalarKind, value: Scalar) -> bytes:
    if isinstance(value, bytes) and kind.leaf == "bytes":
        return value
    if not isinstance(value, str) or kind.leaf == "bytes":
        raise PayloadError(f"{value!r} is not of type {kind.leaf}")
    return encoded_text(value)


def _bits(kind: ScalarKind) -> int:
    return 64 if kind.leaf.endswith("64") else 32
