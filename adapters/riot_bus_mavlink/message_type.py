"""The type of one message of MAVLink: fields of frames, read lazily and patched in place."""

from __future__ import annotations

import struct
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from riot_bus.types.fields import FieldType
from riot_bus.types.model import Leaf, Schema
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_mavlink.definitions import Place
from riot_bus_mavlink.exceptional import allows_nan, exceptional_values, why_brittle
from riot_bus_mavlink.frame import SIGNATURE, SIGNED, V1, V2, load_crc, trimmed
from riot_bus_mavlink.schema_text import ENCODING, schema_of
from riot_bus_mavlink.slots import HEADER, NumberSlot, Slot, find_slot, slots_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from typing import Any

    from numpy.typing import NDArray

    from riot_bus.types.capabilities import SuggestedValue
    from riot_bus.types.payloads import Gathered, Payloads
    from riot_bus.vocabulary.message import Scalar
    from riot_bus_mavlink.definitions import EnumTable, FieldText, MessageTable
    from riot_bus_mavlink.signing import Signer

PREFIX = "mavlink/"
"""Prefix of type names, as in `mavlink/HEARTBEAT`."""

_V2 = bytes([V2])
_BYTE = struct.Struct("<B")


class _Parts(NamedTuple):
    """Where the payload of a frame begins and ends, its version, and whether it is signed."""

    start: int
    end: int
    version: int
    signed: bool


class MavlinkType:
    """Frames of one message, of MAVLink 1 and 2.

    Fields of the message have their own names; those of the header are `header.sequence`, `header.system_id` and
    `header.component_id`. A patch updates the frame's length and checksum. Frames whose checksum is wrong are opaque,
    so that no change makes a damaged frame valid.

    Args:
        message: Definition of the message.
        enums: The enums that its fields refer to.
        signer: Re-signs a changed signed frame with the timestamp that it has; without it, they are not changed.
    """

    encoding = ENCODING

    def __init__(self, message: MessageTable, enums: Mapping[str, EnumTable], *, signer: Signer | None = None) -> None:
        self.name = PREFIX + message.name
        self.message = message
        self._enums = enums
        self._signer = signer
        self._slots = slots_of(message)
        self._crc = load_crc()
        self._extra = bytes([message.crc_extra])

    @cached_property
    def schema(self) -> Schema:
        """The definition as a dialect's XML, with the enums that it refers to."""
        return schema_of(self.name, self.message, self._enums)

    def leaves(self, payload: bytes, *, elements: int = 16) -> Sequence[Leaf]:
        """List the fields of the header, then those of the message in the order of its definition."""
        parts = self._parts(payload)
        found = [Leaf(path, "uint8", payload[places[parts.version - 1]]) for path, places in HEADER.items()]
        body = self._body(payload, parts)
        size = len(body)
        for path, slot in self._slots.items():
            if slot.end <= size and (path[-1] != "]" or int(path[path.rindex("[") + 1 : -1]) < elements):
                found.append(Leaf(path, slot.kind, slot.read(body)))
        return found

    def opaque(self, payload: bytes) -> str | None:
        """Return why the payload cannot be taken apart, None if it can."""
        try:
            self._parts(payload)
        except PayloadError as error:
            return error.message
        return None

    def read(self, payload: bytes, path: str) -> Scalar:
        """Return one field's value (`len(path)` for the length of an array)."""
        parts = self._parts(payload)
        places = HEADER.get(path)
        if places is not None:
            return payload[places[parts.version - 1]]
        slot = self._slot(path)
        self._check_place(slot, parts)
        if isinstance(slot, Place):
            return slot.field.array
        return slot.read(payload[parts.start : parts.end])

    def patch(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the frame with some values replaced and new length and checksum, re-signed if it was signed."""
        parts = self._parts(payload)
        if not changes:
            return payload
        head = bytearray(payload[: parts.start])
        body = bytearray(self._body(payload, parts))
        for path, value in changes.items():
            places = HEADER.get(path)
            if places is not None:
                head[places[parts.version - 1]] = NumberSlot(path, "uint8", 0, _BYTE).pack(value)[0]
                continue
            slot = self._slot(path)
            if isinstance(slot, Place):
                raise PayloadError("this array has a fixed length", where=f"{self.name}: {path}")
            self._check_place(slot, parts)
            body[slot.offset : slot.end] = slot.pack(value)
        return self._closed(payload, parts, bytes(head), bytes(body))

    rebuild = patch

    def patcher(self, path: str, value: Scalar) -> Callable[[bytes], bytes] | None:
        """Return a function that sets a field to a fixed value."""
        slot = None if path in HEADER else self._slot(path)
        if slot is None or isinstance(slot, Place):
            return None
        packed = slot.pack(value)
        start, end = slot.offset, slot.end
        crc, extra, number = self._crc, self._extra, self.message.id.to_bytes(3, "little")
        first, last = 10 + start, 10 + end

        def patch(payload: bytes) -> bytes:
            stop = len(payload) - 2
            # The usual frame: unsigned, of MAVLink 2, and its length stays since its last byte is not changed.
            if stop > last and payload[0] == V2 and payload[1] == stop - 10 and payload[2] == 0:
                check = payload[stop] | payload[stop + 1] << 8
                if payload[stop - 1] and payload[7:10] == number and crc(payload[1:stop] + extra, 0xFFFF) == check:
                    body = payload[1:first] + packed + payload[last:stop]
                    return _V2 + body + crc(body + extra, 0xFFFF).to_bytes(2, "little")
            parts = self._parts(payload)
            body = self._body(payload, parts)
            if end > len(body):
                return self.patch(payload, {path: value})  # raises an error that says what is wrong
            body = b"%b%b%b" % (body[:start], packed, body[end:])
            return self._closed(payload, parts, payload[: parts.start], body)

        return patch

    def fields(self) -> Sequence[FieldType]:
        """List the fields, those of the header first."""
        found = [FieldType(path, "uint8") for path in HEADER]
        for name, place in self.message.places.items():
            field = place.field
            if field.type == "char":
                found.append(FieldType(name, "string", high=field.size))
                continue
            low, high = self._bounds(field)
            path = f"{name}[*]" if field.array else name
            table = self._enums.get(field.enum)
            names = sorted((value, entry.name) for value, entry in (table.entries.items() if table else ()))
            found.append(FieldType(path, field.kind, field.array, low, high, field.unit, tuple(names)))
        return found

    def gather(self, payloads: Payloads, path: str) -> Gathered:
        """Return one field of many frames in its own type, as `riot_bus.types.capabilities.GathersFields` says."""
        import numpy as np

        from riot_bus.types.payloads import Gathered

        slot = None if path in HEADER else self._slot(path)
        dtype = "uint8" if slot is None else "uint32" if isinstance(slot, Place) else slot.kind
        text = dtype == "string"
        values: NDArray[Any] = np.zeros(len(payloads), object if text else dtype)
        if text or dtype.startswith("float"):
            values[:] = None if text else np.nan
        valid = np.zeros(len(payloads), np.bool_)
        for row, payload in enumerate(payloads):
            try:
                values[row] = self.read(payload, path)
            except PayloadError:
                continue
            valid[row] = True
        return Gathered(values, valid)

    def elements(self, payloads: Payloads, path: str) -> Iterator[NDArray[Any]]:
        """Yield the elements of an array of numbers, as `riot_bus.types.capabilities.DescribesFields` says."""
        import numpy as np

        place = self.message.places.get(path)
        if place is None or not place.field.array or place.field.type == "char":
            raise PayloadError("there is no such array", where=f"{self.name}: {path}")
        dtype = np.dtype(place.field.kind).newbyteorder("<")
        for payload in payloads:
            if self.opaque(payload) is None:
                body = self._body(payload, self._parts(payload))
                if place.end <= len(body):
                    yield np.frombuffer(body, dtype, place.field.array, place.offset)

    def exceptional(self, payload: bytes, path: str) -> Sequence[SuggestedValue]:
        """Return values worth trying, as `riot_bus.types.capabilities.SuggestsValues` says."""
        return exceptional_values(self, self.message, self._enums, payload, path)

    def brittle(self, path: str) -> str | None:
        """Return why a field should not be changed, as `riot_bus.types.capabilities.KnowsBrittleFields` says."""
        return why_brittle(self.message, path)

    def allows_non_finite(self, path: str) -> bool:
        """Return whether NaN is not a fault, as `riot_bus.types.capabilities.AllowsNonFinite` says."""
        return allows_nan(self.message, path)

    def _parts(self, payload: bytes) -> _Parts:
        """Return where the parts of a frame are; raises PayloadError if it is not a frame of this message."""
        size = len(payload)
        first = payload[0] if size >= 12 or (size >= 8 and payload[0] == V1) else 0
        if first == V2:
            signed = payload[2] == SIGNED
            end = 10 + payload[1]
            if payload[2] & ~SIGNED or end + 2 + SIGNATURE * signed != size:
                raise PayloadError(f"opaque: {size} bytes that are not a frame of MAVLink 2")
            number = payload[7] | payload[8] << 8 | payload[9] << 16
            parts = _Parts(10, end, 2, signed)
        elif first == V1:
            end = 6 + payload[1]
            if end + 2 != size:
                raise PayloadError(f"opaque: {size} bytes that are not a frame of MAVLink 1")
            number = payload[5]
            parts = _Parts(6, end, 1, signed=False)
        else:
            raise PayloadError(f"opaque: {size} bytes that are not a frame of MAVLink")
        if number != self.message.id:
            raise PayloadError(f"opaque: message {number} instead of {self.message.id}, {self.message.name}")
        if self._crc(payload[1:end] + self._extra, 0xFFFF) != payload[end] | payload[end + 1] << 8:
            problem = "it is damaged, or its sender's dialect defines the message differently"
            raise PayloadError(f"opaque: wrong checksum of a MAVLink frame of {self.message.name}: {problem}")
        if parts.version == 1 and end - 6 < self.message.base_size:
            raise PayloadError(f"opaque: a payload of {end - 6} bytes instead of {self.message.base_size}")
        return parts

    def _closed(self, payload: bytes, parts: _Parts, head: bytes, body: bytes) -> bytes:
        """Return a frame with another header and payload."""
        if parts.version == 2:
            cut = trimmed(body)
            if payload[parts.end - 1] == 0 and parts.end - parts.start > 1:  # its sender does not trim
                cut = cut.ljust(min(parts.end - parts.start, len(body)), b"\0")
            body = cut
        frame = b"%c%c%b%b" % (head[0], len(body), head[2:], body)
        frame += self._crc(frame[1:] + self._extra, 0xFFFF).to_bytes(2, "little")
        if not parts.signed:
            return frame
        if self._signer is None:
            hint = 'name its key: adapters = ["mavlink:key_file=FILE"] in riot.toml'
            raise PayloadError("a signed frame cannot be changed without the key", where=self.name, hint=hint)
        if not self._signer.made(payload):
            hint = "it was signed with another key, or broken on its way"
            raise PayloadError("a frame with a wrong signature is not changed", where=self.name, hint=hint)
        return self._signer.sign(frame, payload[-13], int.from_bytes(payload[-12:-6], "little"))

    def _body(self, payload: bytes, parts: _Parts) -> bytes:
        """Return the payload of a frame; in MAVLink 2, zeros that were cut off are restored."""
        body = payload[parts.start : parts.end]
        return body.ljust(self.message.size, b"\0") if parts.version == 2 else body

    def _slot(self, path: str) -> Slot | Place:
        return self._slots.get(path) or find_slot(self._slots, self.message, path)

    def _check_place(self, slot: Slot | Place, parts: _Parts) -> None:
        if parts.version == 1 and slot.end > parts.end - parts.start:
            raise PayloadError("this frame of MAVLink 1 has no such field", where=self.name)

    def _bounds(self, field: FieldText) -> tuple[float | None, float | None]:
        table = self._enums.get(field.enum)
        if table is None or not table.entries or field.low is not None or field.high is not None:
            return field.low, field.high
        return (0, table.flags) if table.bitmask or field.bitmask else (min(table.entries), max(table.entries))
