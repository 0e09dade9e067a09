"""MessagePack payloads. Format: https://github.com/msgpack/msgpack/blob/master/spec.md.

Extension types are not fields.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from riot_bus.types.capabilities import StandIn
from riot_bus.types.document import Code, DocumentType
from riot_bus.vocabulary.errors import PayloadError

_CODES = (
    *(Code("uint", number=number) for number in range(128)),
    *(Code("map", number=number) for number in range(16)),
    *(Code("array", number=number) for number in range(16)),
    *(Code("str", number=number) for number in range(32)),
    Code("nil"), Code(""), Code("bool", number=False), Code("bool", number=True),
    Code("bin", 1), Code("bin", 2), Code("bin", 4), Code("ext", 1), Code("ext", 2), Code("ext", 4),
    Code("float", 4), Code("float", 8),
    Code("uint", 1), Code("uint", 2), Code("uint", 4), Code("uint", 8),
    Code("int", 1), Code("int", 2), Code("int", 4), Code("int", 8),
    *(Code("ext", number=number) for number in (1, 2, 4, 8, 16)),
    Code("str", 1), Code("str", 2), Code("str", 4), Code("array", 2), Code("array", 4), Code("map", 2), Code("map", 4),
    *(Code("int", number=number) for number in range(-32, 0)),
)  # fmt: skip


class MsgpackType(DocumentType):
    """Every MessagePack document: the payload describes itself."""

    name = "msgpack"
    encoding = "msgpack"
    title = "MessagePack"
    codes = _CODES
    signed = True
    stand_ins: ClassVar[Mapping[StandIn, bytes]] = {"null": b"\xc0", "list": b"\x90", "map": b"\x80"}

    def is_container(self, payload: bytes) -> bool:
        """Return whether the payload is exactly one non-empty MessagePack map or array."""
        if not payload or _CODES[payload[0]].kind not in ("map", "array"):
            return False
        try:
            return self.head(payload, 0).entries > 0 and self.skip(payload, 0) == len(payload)
        except PayloadError:
            return False
