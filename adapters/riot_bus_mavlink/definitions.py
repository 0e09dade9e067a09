"""Definitions of messages in a dialect: fields with their places, units, enums and markers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from riot_bus_mavlink.frame import load_crc

LONGEST_PAYLOAD = 255  # a frame tells the length of its payload in one byte

SIZES = {
    "char": 1, "int8_t": 1, "uint8_t": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4, "float": 4,
    "int64_t": 8, "uint64_t": 8, "double": 8,
}  # fmt: skip
"""Bytes of one element, by the name of its type in dialects."""

_TYPES = {"char": "string", "float": "float32", "double": "float64"}


class DialectError(ValueError):
    """The definition of a message is impossible."""


@dataclass(frozen=True, slots=True)
class FieldText:
    """A field as a dialect's file defines it.

    Attributes:
        type: Type of an element, one of `SIZES`, such as `int32_t`.
        array: Number of elements, 0 if it is not an array.
        extension: Whether it is absent in MAVLink 1 and does not count for `crc_extra`.
        unit: Unit as written in the file: `degE7`, `cdeg`, `mm`, `d%`.
        enum: Name of the enum of its values.
        bitmask: Whether its values are flags, in any combination.
        invalid: The marker for "not known": `UINT16_MAX`, `NaN`, `[NaN:]`.
        low: Smallest sensible value.
        high: Largest sensible value.
    """

    name: str
    type: str
    array: int = 0
    extension: bool = False
    unit: str = ""
    enum: str = ""
    bitmask: bool = False
    invalid: str = ""
    low: float | None = None
    high: float | None = None

    @property
    def size(self) -> int:
        """Number of bytes that it takes."""
        return SIZES[self.type] * (self.array or 1)

    @property
    def kind(self) -> str:
        """Type of one value as riot names it: `int32`, `float32`, `string`."""
        return _TYPES.get(self.type) or self.type.removesuffix("_t")


@dataclass(frozen=True, slots=True)
class Place:
    """A field and its offset in the payload."""

    field: FieldText
    offset: int

    @property
    def end(self) -> int:
        """The first byte after it."""
        return self.offset + self.field.size


@dataclass(frozen=True, slots=True)
class MessageTable:
    """A message of a dialect.

    Attributes:
        id: Message id, 0 to 16777215.
        places: Its fields in the order of its definition.
        base_size: Bytes of its payload in MAVLink 1.
        size: Bytes of its payload in MAVLink 2, before trailing zeros are cut off.
        crc_extra: CRC extra byte, which stands for the definition in the checksum.
    """

    id: int
    name: str
    places: Mapping[str, Place]
    base_size: int
    size: int
    crc_extra: int

    @property
    def targets(self) -> tuple[int | None, int | None]:
        """Payload offsets of `target_system` and `target_component`, None where there is none."""
        system, component = (self.places.get(name) for name in ("target_system", "target_component"))
        return (None if system is None else system.offset, None if component is None else component.offset)


@dataclass(frozen=True, slots=True)
class Param:
    """Definition of one of the seven parameters of a command in MAV_CMD."""

    index: int
    label: str = ""
    unit: str = ""
    enum: str = ""
    low: float | None = None
    high: float | None = None
    increment: float | None = None
    reserved: bool = False


@dataclass(frozen=True, slots=True)
class EnumEntry:
    """One value of an enum of a dialect.

    Attributes:
        params: Definitions of its parameters if it is a command, which is a value of MAV_CMD; otherwise none.
    """

    name: str
    value: int
    params: Sequence[Param] = ()


@dataclass(slots=True)
class EnumTable:
    """The values of an enum, from all files that add to it."""

    name: str
    bitmask: bool = False
    entries: dict[int, EnumEntry] = field(default_factory=dict)

    @property
    def flags(self) -> int:
        """All bits of a bitmask."""
        bits = 0
        for value in self.entries:
            bits |= value
        return bits


def make_message(message_id: int, name: str, fields: Sequence[FieldText]) -> MessageTable:
    """Return a message with the places of its fields: larger types first, extensions last, in their order.

    Raises:
        DialectError: Two fields have the same name, or the fields do not fit in a payload.
    """
    base = sorted((each for each in fields if not each.extension), key=lambda each: -SIZES[each.type])
    offsets: dict[str, int] = {}
    size = base_size = 0
    for each in (*base, *(each for each in fields if each.extension)):
        if each.name in offsets:
            raise DialectError(f"two fields are called {each.name!r}")
        offsets[each.name] = size
        size += each.size
        base_size = base_size if each.extension else size
    if size > LONGEST_PAYLOAD:
        raise DialectError(f"its fields take {size} bytes of {LONGEST_PAYLOAD}")
    places = {each.name: Place(each, offsets[each.name]) for each in fields}
    return MessageTable(message_id, name, places, base_size, size, _crc_extra(name, base))


def _crc_extra(name: str, base: Sequence[FieldText]) -> int:
    text = b"%b " % name.encode()
    for each in base:
        text += b"%b %b " % (each.type.encode(), each.name.encode())
        if each.array:
            text += bytes([each.array])
    crc = load_crc()(text, 0xFFFF)
    return (crc & 0xFF) ^ (crc >> 8)
