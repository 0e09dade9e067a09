"""Single values in a frame: where they are, and how they are read and written."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.types.model import encoded_text, parse_path, wrap_integer
from riot_bus.vocabulary.errors import PayloadError, did_you_mean

if TYPE_CHECKING:
    from riot_bus.vocabulary.message import Scalar
    from riot_bus_mavlink.definitions import MessageTable, Place

CODES = {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q",
    "float32": "f", "float64": "d",
}  # fmt: skip
"""Letters of `struct` by the type of a number."""

HEADER = {"header.sequence": (2, 4), "header.system_id": (3, 5), "header.component_id": (4, 6)}
"""Fields of the header, and where they are in frames of MAVLink 1 and 2; all are of type uint8."""


@dataclass(frozen=True, slots=True)
class NumberSlot:
    """A number at a place of the payload."""

    path: str
    kind: str
    offset: int
    form: struct.Struct

    @property
    def end(self) -> int:
        """The first byte after it."""
        return self.offset + self.form.size

    def read(self, body: bytes) -> Scalar:
        """Return the value; bytes that a payload lacks are zeros."""
        if len(body) < self.offset + self.form.size:
            body = body.ljust(self.offset + self.form.size, b"\0")
        value: Scalar = self.form.unpack_from(body, self.offset)[0]
        return value

    def pack(self, value: Scalar) -> bytes:
        """Return the bytes of a value; integers wrap, floats overflow to infinity.

        Raises:
            PayloadError: The value is not a number, or not finite for an integer.
        """
        if isinstance(value, str | bytes):
            raise PayloadError(f"{value!r} is not of type {self.kind}", where=self.path)
        if self.kind.startswith("float"):
            try:
                return self.form.pack(float(value))
            except OverflowError:
                return self.form.pack(math.inf if value > 0 else -math.inf)
        if isinstance(value, float) and not math.isfinite(value):
            raise PayloadError(f"{value!r} is not of type {self.kind}", where=self.path)
        return self.form.pack(wrap_integer(int(value), bits=8 * self.form.size, signed=self.kind[0] == "i"))


@dataclass(frozen=True, slots=True)
class TextSlot:
    """An array of characters: text that ends at the first NUL, or at the end of the array."""

    path: str
    offset: int
    size: int

    kind = "string"

    @property
    def end(self) -> int:
        """The first byte after it."""
        return self.offset + self.size

    def read(self, body: bytes) -> Scalar:
        """Return the text; bytes that are not UTF-8 become surrogates."""
        data = body[self.offset : self.offset + self.size].partition(b"\0")[0]
        return data.decode(errors="surrogateescape")

    def pack(self, value: Scalar) -> bytes:
        """Return the bytes of a text, padded with NULs or cut to the size of the array.

        Raises:
            PayloadError: The value is not text, or cannot be encoded.
        """
        if not isinstance(value, str):
            raise PayloadError(f"{value!r} is not text", where=self.path)
        return encoded_text(value, self.path)[: self.size].ljust(self.size, b"\0")


Slot = NumberSlot | TextSlot


def slots_of(message: MessageTable) -> dict[str, Slot]:
    """Return the single values of a message by path, in the order of its definition."""
    return {slot.path: slot for name, place in message.places.items() for slot in _slots(name, place)}


def find_slot(slots: dict[str, Slot], message: MessageTable, path: str) -> Slot | Place:
    """Return the value that a path names, or the array whose length it names.

    Raises:
        PayloadError: There is no such field.
    """
    if (slot := slots.get(path)) is not None:
        return slot
    parsed = parse_path(path)
    place = message.places.get(path[len("len(") : -1]) if parsed.length else None
    if place is not None and place.field.array and place.field.type != "char":
        return place
    raise PayloadError("no such field", where=f"{message.name}: {path}", hint=did_you_mean(path, [*slots, *HEADER]))


def _slots(name: str, place: Place) -> list[Slot]:
    field = place.field
    if field.type == "char":
        return [TextSlot(name, place.offset, field.size)]
    form = struct.Struct("<" + CODES[field.kind])
    if not field.array:
        return [NumberSlot(name, field.kind, place.offset, form)]
    return [
        NumberSlot(f"{name}[{index}]", field.kind, place.offset + index * form.size, form)
        for index in range(field.array)
    ]
