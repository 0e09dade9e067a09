"""One Protocol Buffers message type: fields are read, patched and rebuilt in place in the wire format.

Fields have the names of the .proto file. Entries of maps are members (`counts.left`, `names[3]`), enums are numbers. A
field without presence (`proto3` without `optional`) always exists, zero or empty if it is not on the wire; other fields
exist only in payloads that set them. Unknown fields, extensions, and the order on the wire are kept.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from riot_bus.types.model import (
    MAX_DEPTH,
    REBUILD,
    Leaf,
    Schema,
    check_leaves,
    check_size,
    member_path,
    parse_path,
    rebuilt,
    why_opaque,
)
from riot_bus.vocabulary.errors import PayloadError, did_you_mean
from riot_bus_protobuf.edits import Edit, apply
from riot_bus_protobuf.static import static_fields
from riot_bus_protobuf.walk import (
    EntrySpan,
    FieldEntry,
    Slot,
    count,
    element,
    elements,
    fields_of,
    found_of,
    last,
    packed,
    part_of,
    size,
    slot_of,
    whole,
)
from riot_bus_protobuf.wire import BYTES, END_GROUP, GROUP, decode, encode, tag, varint

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from riot_bus.types.fields import FieldType
    from riot_bus.types.payloads import Payloads
    from riot_bus.vocabulary.message import Scalar
    from riot_bus_protobuf.layout import Definitions, Layout, ProtobufField


class _Spot(NamedTuple):
    """The place of a field, or where it would be.

    Attributes:
        slot: Place of its value; None if it is not on the wire or is an array.
        part: The innermost message around it that is on the wire.
        missing: Messages between that one and the field that are not on the wire.
    """

    field: ProtobufField
    found: Sequence[FieldEntry]
    slot: Slot | None
    part: EntrySpan
    missing: tuple[ProtobufField, ...]


class ProtobufType:
    """One message type.

    Args:
        schema: Definition from a log; by default made from `definitions`.
    """

    encoding = "protobuf"

    def __init__(self, name: str, definitions: Definitions, *, schema: Schema | None = None) -> None:
        layout = definitions.layout(name)
        if layout is None:
            raise KeyError(name)
        self.name = name
        self._layout = layout
        self._definitions = definitions
        self._schema = schema

    @property
    def schema(self) -> Schema:
        """Descriptor set of the required files."""
        if self._schema is None:
            self._schema = Schema(self.name, "protobuf", self._definitions.serialized(self.name))
        return self._schema

    def leaves(self, payload: bytes, *, elements: int = 16) -> Sequence[Leaf]:
        """List the scalar fields in the order of the definition."""
        found: list[Leaf] = []
        self._collect(payload, self._layout, whole(payload), "", elements, 0, found)
        return found

    def opaque(self, payload: bytes) -> str | None:
        """Return why the payload cannot be decoded, None if it can."""
        return why_opaque(self, payload)

    def fields(self) -> Sequence[FieldType]:
        """List the fields that messages of this type may have; a recursive type is listed once."""
        return static_fields(self._definitions, self._layout)

    def elements(self, payloads: Payloads, path: str) -> Iterator[NDArray[Any]]:
        """Yield the elements of an array of numbers; see `riot_bus.types.capabilities.DescribesFields`."""
        field = next((each for each in self.fields() if each.path == f"{path}[*]"), None)
        if field is None or field.type in ("string", "bytes"):
            raise PayloadError("there is no such array of numbers", where=f"{self.name}: {path}")
        return self._arrays(payloads, path, np.dtype(field.type))

    def _arrays(self, payloads: Payloads, path: str, dtype: np.dtype[Any]) -> Iterator[NDArray[Any]]:
        for payload in payloads:
            with suppress(PayloadError):
                yield np.array(self.array(payload, path), dtype)

    def read(self, payload: bytes, path: str) -> Scalar:
        """Return one field's value (`len(path)` for the length of an array)."""
        spot = self._find(payload, path)
        field = spot.field
        if parse_path(path).length:
            return count(payload, field, spot.found)
        assert field.kind is not None
        if spot.slot is not None:
            return decode(field.kind, payload, spot.slot.start, spot.slot.end)
        if field.presence or spot.missing:
            raise PayloadError("this field is not set", where=f"{self.name}: {path}")
        return field.default

    def patch(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with some scalars replaced in place by values of the same size."""
        edits = self._edits(payload, changes)
        if any(edit.growth for edit in edits):
            path = next(path for path in changes if self._edits(payload, {path: changes[path]})[0].growth)
            where = f"{self.name}: {path}"
            raise PayloadError("the new value takes a different number of bytes", where=where, hint=REBUILD)
        return apply(payload, edits)

    def rebuild(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with fields set and lengths of arrays changed; only enclosing length prefixes are updated.

        A scalar that is not on the wire is added at the end of its message, with the messages around it.
        """
        return rebuilt(payload, changes, self._resized, lambda data, scalars: apply(data, self._edits(data, scalars)))

    def array(self, payload: bytes, path: str) -> list[Scalar]:
        """Return all elements of an array of scalars."""
        spot = self._find(payload, f"len({path})")
        kind = spot.field.kind
        if kind is None:
            raise PayloadError("the elements of this array are messages", where=f"{self.name}: {path}")
        slots = elements(payload, spot.field, spot.found, len(payload))
        return [decode(kind, payload, each.start, each.end) for each in slots if isinstance(each, Slot)]

    def _collect(
        self,
        payload: bytes,
        layout: Layout,
        parts: Sequence[EntrySpan],
        path: str,
        most: int,
        depth: int,
        leaves: list[Leaf],
    ) -> None:
        if depth > MAX_DEPTH:
            raise PayloadError(f"{self.name} is nested deeper than {MAX_DEPTH}")
        check_leaves(len(leaves), most)  # an element of two bytes may have thousands that are not on the wire
        present = fields_of(payload, layout, parts)
        for field in layout.fields.values():
            found = present.get(field.number, ())
            here = member_path(path, field.name)
            entry = self._definitions.entry(field)
            if entry is not None:
                for key, one in self._entries(payload, entry, found).items():
                    self._add_value(payload, entry, one, member_path(here, key), most, depth + 1, leaves)
            elif field.repeated:
                leaves.append(Leaf(f"len({here})", "uint32", count(payload, field, found)))
                for index, each in enumerate(elements(payload, field, found, most)):
                    place = f"{here}[{index}]"
                    if isinstance(each, Slot):
                        leaves.append(self._leaf(payload, field, each, place))
                    else:
                        inside = self._definitions.inside(field)
                        self._collect(payload, inside, (part_of(each),), place, most, depth + 1, leaves)
            elif field.kind is None:
                if found:
                    inside = self._definitions.inside(field)
                    self._collect(payload, inside, [part_of(one) for one in found], here, most, depth + 1, leaves)
            elif found or not field.presence:
                leaves.append(self._leaf(payload, field, slot_of(found[-1]) if found else None, here))

    def _leaf(self, payload: bytes, field: ProtobufField, slot: Slot | None, path: str) -> Leaf:
        assert field.kind is not None
        value = field.default if slot is None else decode(field.kind, payload, slot.start, slot.end)
        return Leaf(path, field.kind.leaf, value)

    def _entries(self, payload: bytes, entry: Layout, found: Sequence[FieldEntry]) -> dict[str | int, FieldEntry]:
        """Return the last entry of each key."""
        last_of: dict[str | int, FieldEntry] = {}
        for one in found:
            key = entry.numbers[1]
            inside = found_of(payload, entry, (part_of(one),), key)
            value = self._leaf(payload, key, slot_of(inside[-1]) if inside else None, "").value
            last_of[str(value).lower() if isinstance(value, bool | float | bytes) else value] = one
        return last_of

    def _add_value(
        self, payload: bytes, entry: Layout, one: FieldEntry, path: str, most: int, depth: int, leaves: list[Leaf]
    ) -> None:
        field = entry.numbers[2]
        found = found_of(payload, entry, (part_of(one),), field)
        if field.kind is not None:
            leaves.append(self._leaf(payload, field, slot_of(found[-1]) if found else None, path))
        elif found:
            inside = self._definitions.inside(field)
            self._collect(payload, inside, [part_of(each) for each in found], path, most, depth, leaves)

    def _find(self, payload: bytes, path: str) -> _Spot:
        try:
            return self._walk(payload, path)
        except PayloadError as error:
            error.where = error.where or f"{self.name}: {path}"
            raise

    def _walk(self, payload: bytes, path: str) -> _Spot:
        steps = list(reversed(parse_path(path).steps))
        length = parse_path(path).length
        layout, parts = self._layout, whole(payload)
        missing: tuple[ProtobufField, ...] = ()
        while True:
            field = _member(layout, steps.pop())
            found: Sequence[FieldEntry] = ()
            if not missing:
                found = found_of(payload, layout, parts, field)
            entry = self._definitions.entry(field)
            if entry is not None:
                one = self._chosen(payload, entry, found, steps)
                parts = (part_of(one),)
                field = entry.numbers[2]
                found = found_of(payload, entry, parts, field)
            elif field.repeated:
                if not steps:
                    if not length:
                        raise PayloadError("this field is an array", hint="write 'len(name)' or 'name[3]' for arrays")
                    return _Spot(field, found, None, parts[-1], missing)
                index = steps.pop()
                if not isinstance(index, int):
                    raise PayloadError(f"no field {index!r} here", hint="elements are written 'name[3]'")
                each = element(payload, field, found, index)
                if isinstance(each, Slot):
                    _check_end(steps, length=length)
                    return _Spot(field, (), each, parts[-1], missing)
                found = (each,)
            if field.kind is not None:
                _check_end(steps, length=length)
                return _Spot(field, found, slot_of(found[-1]) if found else None, parts[-1], missing)
            layout = self._definitions.inside(field)
            if not steps:
                raise PayloadError("a message is not a scalar field", hint=did_you_mean("", layout.fields))
            if found:
                parts = tuple(part_of(one) for one in found)
            else:
                missing = (*missing, field)

    def _chosen(self, payload: bytes, entry: Layout, found: Sequence[FieldEntry], steps: list[str | int]) -> FieldEntry:
        known = self._entries(payload, entry, found)
        if not steps:
            raise PayloadError("a map is not a scalar field", hint=did_you_mean("", map(str, known)))
        key = steps.pop()
        if key not in known:
            raise PayloadError(f"no entry {key!r}", hint=did_you_mean(str(key), map(str, known)))
        return known[key]

    def _edits(self, payload: bytes, changes: Mapping[str, Scalar]) -> list[Edit]:
        edits: dict[tuple[int, int, int], Edit] = {}
        for path, value in changes.items():
            if parse_path(path).length:
                raise PayloadError("a length cannot be patched in place", where=path, hint=REBUILD)
            spot = self._find(payload, path)
            field, slot = spot.field, spot.slot
            assert field.kind is not None
            try:
                data = encode(field.kind, value)
            except PayloadError as error:
                error.where = error.where or f"{self.name}: {path}"
                raise
            if slot is None:
                if field.kind.wire == BYTES:
                    data = varint(len(data)) + data
                data = _wrapped(tag(field.number, field.kind.wire) + data, spot.missing)
                edits[spot.part.end, spot.part.end, len(edits) + 1] = Edit(
                    spot.part.end, spot.part.end, data, spot.part.box
                )
            else:
                edits[slot.start, slot.end, 0] = Edit(slot.start, slot.end, data, slot.box)
        return list(edits.values())

    def _resized(self, payload: bytes, path: str, wanted: int) -> bytes:
        spot = self._find(payload, path)
        field, found = spot.field, [one for one in spot.found if size(payload, spot.field, one)]
        present = count(payload, field, found)
        if wanted <= present:
            return apply(payload, _cut(payload, field, found, present - wanted))
        more = wanted - present
        if not found:
            part = spot.part
            check_size(len(payload) + more, path)
            return apply(payload, [Edit(part.end, part.end, _wrapped(_empty(field, more), spot.missing), part.box)])
        one = found[-1]
        if packed(field, one):
            slot = last(payload, field, one)
            data, place, box = payload[slot.start : slot.end], slot.end, slot.box
        else:
            data, place, box = payload[one.entry.start : one.entry.after], one.entry.after, one.part.box
        check_size(len(payload) + more * len(data), path)
        return apply(payload, [Edit(place, place, data * more, box)])


def _member(layout: Layout, step: str | int) -> ProtobufField:
    field = layout.fields.get(step) if isinstance(step, str) else None
    if field is None:
        raise PayloadError(f"no field {step!r}", hint=did_you_mean(str(step), layout.fields))
    return field


def _check_end(steps: Sequence[str | int], *, length: bool) -> None:
    if steps:
        raise PayloadError(f"no field {steps[-1]!r} here: this is a scalar")
    if length:
        raise PayloadError("only arrays have a length")


def _wrapped(data: bytes, around: Sequence[ProtobufField]) -> bytes:
    """Return a field inside messages that are not on the wire yet."""
    for field in reversed(around):
        if field.group:
            data = tag(field.number, GROUP) + data + tag(field.number, END_GROUP)
        else:
            data = tag(field.number, BYTES) + varint(len(data)) + data
    return data


def _empty(field: ProtobufField, number: int) -> bytes:
    """Return the entries of `number` elements that are zero or empty."""
    kind = field.kind
    if field.packed and kind is not None:
        size = number * max(kind.size, 1)
        return tag(field.number, BYTES) + varint(size) + bytes(size)
    if field.group:
        return (tag(field.number, GROUP) + tag(field.number, END_GROUP)) * number
    wire, width = (BYTES, 1) if kind is None else (kind.wire, max(kind.size, 1))
    return (tag(field.number, wire) + bytes(width)) * number


def _cut(payload: bytes, field: ProtobufField, found: Sequence[FieldEntry], less: int) -> list[Edit]:
    """Remove elements from the end of an array."""
    edits = []
    for one in reversed(found):
        if not less:
            break
        here = size(payload, field, one)
        entry = one.entry
        if here <= less:
            edits.append(Edit(entry.start, entry.after, b"", one.part.box))
            less -= here
        else:
            first = element(payload, field, (one,), here - less)
            assert isinstance(first, Slot)
            edits.append(Edit(first.start, entry.end, b"", first.box))
            less = 0
    return edits
