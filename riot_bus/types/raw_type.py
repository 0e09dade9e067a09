"""Opaque payloads, and packed C structures whose layout is part of the type's name.

`raw` means bytes without fields; `raw(uint32 seq, float32[3] gyro, int16be temperature @20)` means consecutive fields,
or fields at a byte offset (`@`).
"""

from __future__ import annotations

import math
import re
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from riot_bus.types.fields import FieldType
from riot_bus.types.model import Leaf, Schema, packed_float, parse_path, wrap_integer
from riot_bus.vocabulary.errors import ConfigError, PayloadError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path
    from typing import Any

    from numpy.typing import NDArray

    from riot_bus.types.payloads import Payloads
    from riot_bus.vocabulary.message import Scalar

_CODES = {
    "bool": "?", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q",
    "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_FIELD = re.compile(r"([a-z]+[0-9]*)(be)?(?:\[([0-9]{1,6})\])? +([A-Za-z_][A-Za-z0-9_.]*)(?: *@ *([0-9]{1,8}))?")
_ELEMENT = re.compile(r"(.+)\[(0|[1-9][0-9]{0,5})\]")
_MOST_PLACES = 100_000  # logs and peers may name such types: bounds the leaves of a payload
_EXAMPLE = "write it like 'raw(uint32 seq, float32[3] gyro, int16be temperature @20)'"


@dataclass(eq=False)
class OpaqueType:
    """A type whose payloads are never decoded."""

    name: str
    encoding: str
    reason: str
    schema: ClassVar[Schema | None] = None

    def opaque(self, payload: bytes) -> str | None:
        """Return why the payload cannot be decoded."""
        del payload
        return self.reason

    def leaves(self, payload: bytes, *, elements: int = 16) -> Sequence[Leaf]:
        """Raise PayloadError."""
        del payload, elements
        raise self._error()

    def read(self, payload: bytes, path: str) -> Scalar:
        """Raise PayloadError."""
        del payload
        raise self._error(path)

    def patch(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload if there are no changes; raise PayloadError otherwise."""
        if changes:
            raise self._error(next(iter(changes)))
        return payload

    rebuild = patch

    def _error(self, path: str | None = None) -> PayloadError:
        return PayloadError(self.reason, where=path)


class RawType(OpaqueType):
    """The type of undescribed bytes, and the source of types whose names describe their layout."""

    def __init__(self) -> None:
        super().__init__("raw", "raw", "raw bytes have no fields")

    def load(self, files: Sequence[Path]) -> None:
        """Raise ConfigError: layouts are written as names."""
        raise ConfigError("raw types are not defined in files", where=str(files[0]) if files else None, hint=_EXAMPLE)

    def type_named(self, type_name: str) -> StructType | None:
        """Return the type of `raw(FIELDS)`, None for other names.

        Raises:
            ConfigError: The description of the fields is invalid.
        """
        if not (type_name.startswith("raw(") and type_name.endswith(")")):
            return None
        return StructType(type_name)

    def type_of_schema(self, schema: Schema) -> None:
        """Return None: logs do not describe raw bytes."""
        del schema


@dataclass(frozen=True, slots=True)
class _Place:
    """The place of a field; `length` is None unless it is an array."""

    offset: int
    type: str
    form: struct.Struct
    length: int | None = None

    @property
    def end(self) -> int:
        return self.offset + self.form.size * (1 if self.length is None else self.length)

    def element(self, index: int) -> _Place:
        return _Place(self.offset + index * self.form.size, self.type, self.form)


class StructType:
    """Fields at fixed offsets: numbers and arrays of them, without padding, little-endian unless marked with `be`.

    Args:
        name: Name `raw(TYPE NAME, ...)`, where TYPE is bool, int8 ... uint64, float32 or float64, may end with `be`
            for big-endian and with `[N]` for an array, and `@ BYTE` after NAME gives the offset.

    Raises:
        ConfigError: The name is not of this form.
    """

    encoding = "raw"
    schema: Schema | None = None

    def __init__(self, name: str) -> None:
        self.name = name
        self._fields: list[FieldType] = []
        self._places: dict[str, _Place] = {}
        self._number = 0
        end = 0
        for text in name[len("raw(") : -1].split(","):
            end = self._add(text.strip(), end)
        self._size = max((place.end for place in self._places.values()), default=0)

    def fields(self) -> Sequence[FieldType]:
        """List the fields."""
        return self._fields

    def elements(self, payloads: Payloads, path: str) -> Iterator[NDArray[Any]]:
        """Yield the elements of an array; see `riot_bus.types.capabilities.DescribesFields`."""
        place = self._places.get(path)
        if place is None or place.length is None:
            raise PayloadError("there is no such array", where=f"{self.name}: {path}")
        import numpy as np

        dtype, length, offset = np.dtype(place.form.format), place.length, place.offset
        return (np.frombuffer(payload, dtype, length, offset) for payload in payloads if len(payload) >= self._size)

    def leaves(self, payload: bytes, *, elements: int = 16) -> Sequence[Leaf]:
        """List the fields in the order of their description."""
        self._check(payload)
        found = []
        for path, place in self._places.items():
            if place.length is None:
                found.append(Leaf(path, place.type, place.form.unpack_from(payload, place.offset)[0]))
            for index in range(min(place.length or 0, elements)):
                value = place.form.unpack_from(payload, place.offset + index * place.form.size)[0]
                found.append(Leaf(f"{path}[{index}]", place.type, value))
        return found

    def opaque(self, payload: bytes) -> str | None:
        """Return why the payload cannot be decoded, None if it can."""
        return None if len(payload) >= self._size else self._short(payload)

    def read(self, payload: bytes, path: str) -> Scalar:
        """Return one field's value."""
        place = self._place(path)
        if isinstance(place, int):
            return place
        self._check(payload)
        value: Scalar = place.form.unpack_from(payload, place.offset)[0]
        return value

    def patch(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with some scalars replaced in place."""
        self._check(payload)
        data = bytearray(payload)
        for path, value in changes.items():
            place = self._place(path)
            if isinstance(place, int):
                raise PayloadError("this array has a fixed length", where=path)
            _pack(place, data, value, path)
        return bytes(data)

    rebuild = patch

    def _add(self, text: str, end: int) -> int:
        match = _FIELD.fullmatch(text)
        kind, big, length, name, offset = match.groups() if match is not None else ("",) * 5
        if kind not in _CODES:
            hint = did_you_mean(kind, _CODES) if kind else _EXAMPLE
            raise ConfigError(f"{text!r} does not describe a field", where=self.name, hint=hint)
        form = struct.Struct((">" if big else "<") + _CODES[kind])
        start = int(offset) if offset else end
        number = int(length) if length else 1
        self._number += number
        if not number or self._number > _MOST_PLACES or name in self._places:
            raise ConfigError(f"{text!r}: no elements, too many, or a second field of this name", where=self.name)
        self._fields.append(FieldType(f"{name}[*]", kind, number) if length else FieldType(name, kind))
        place = self._places[name] = _Place(start, kind, form, number if length else None)
        return place.end

    def _place(self, path: str) -> _Place | int:
        """Return the place of a field, or the length of an array if the path asks for it."""
        place = self._places.get(path)
        if place is not None and place.length is None:
            return place
        element = _ELEMENT.fullmatch(path)
        if element is not None:
            array = self._places.get(element[1])
            if array is not None and int(element[2]) < (array.length or 0):
                return array.element(int(element[2]))
        elif parse_path(path).length:
            array = self._places.get(path[len("len(") : -1])
            if array is not None and array.length is not None:
                return array.length
        known = [name if each.length is None else f"{name}[0]" for name, each in self._places.items()]
        raise PayloadError("no such field", where=f"{self.name}: {path}", hint=did_you_mean(path, known))

    def _check(self, payload: bytes) -> None:
        if len(payload) < self._size:
            raise PayloadError(self._short(payload))

    def _short(self, payload: bytes) -> str:
        return f"{len(payload)} bytes are too few for {self.name}, which has {self._size}"


def _pack(place: _Place, data: bytearray, value: Scalar, path: str) -> None:
    if isinstance(value, str | bytes) or (
        not place.type.startswith("float") and isinstance(value, float) and not math.isfinite(value)
    ):
        raise PayloadError(f"{value!r} is not of type {place.type}", where=path)
    if place.type == "bool":
        place.form.pack_into(data, place.offset, bool(value))
    elif place.type.startswith("float"):
        data[place.offset : place.end] = packed_float(place.form.format, value)
    else:
        number = wrap_integer(int(value), bits=8 * place.form.size, signed=place.type[0] == "i")
        place.form.pack_into(data, place.offset, number)
