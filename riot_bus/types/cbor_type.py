"""CBOR payloads (RFC 8949).

Tags are transparent: the field is the value that they enclose, and they are kept. Null, undefined and other simple
values are not fields. Containers and strings of indefinite length are read; a patched string gets a definite length.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from riot_bus.types.capabilities import StandIn
from riot_bus.types.document import INDEFINITE, Code, DocumentType

_KINDS = ("uint", "int", "bin", "str", "array", "map", "tag", "simple")
_WIDTHS = {24: 1, 25: 2, 26: 4, 27: 8}  # RFC 8949, section 3: bytes that follow, by the low five bits
_SIMPLE = {
    0xF4: Code("bool", number=False), 0xF5: Code("bool", number=True), 0xF6: Code("nil"),
    0xF9: Code("float", 2), 0xFA: Code("float", 4), 0xFB: Code("float", 8),
}  # fmt: skip


def _code(byte: int) -> Code:
    kind, low = _KINDS[byte >> 5], byte & 31
    if low == 31 and kind in ("bin", "str", "array", "map"):
        return Code(kind, number=INDEFINITE)
    if low >= 24:
        return Code(kind, _WIDTHS[low]) if low in _WIDTHS else Code("")
    return Code(kind, number=~low if kind == "int" else low)


class CborType(DocumentType):
    """Every CBOR document: the payload describes itself."""

    name = "cbor"
    encoding = "cbor"
    title = "CBOR"
    codes = tuple(_SIMPLE.get(byte) or _code(byte) for byte in range(256))
    signed = False
    stand_ins: ClassVar[Mapping[StandIn, bytes]] = {"null": b"\xf6", "list": b"\x80", "map": b"\xa0"}
