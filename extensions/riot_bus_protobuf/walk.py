"""Places of the fields of a message, from its entries on the wire.

A message may be split into several parts, the last entry of a scalar or a oneof counts, and the elements of an array
may be packed or not: https://protobuf.dev/programming-guides/encoding/#last-one-wins.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_protobuf.wire import BYTES, GROUP, entries, read_varint

if TYPE_CHECKING:
    from collections.abc import Container, Iterator, Sequence

    from riot_bus_protobuf.layout import Layout, ProtobufField
    from riot_bus_protobuf.wire import WireField

_ENDS_VARINT = bytes(range(0x80))


class LengthPrefix(NamedTuple):
    """Bytes with a length prefix: the length from `prefix` to `body`, the bytes from `body` to `end`."""

    prefix: int
    body: int
    end: int
    depth: int
    outer: LengthPrefix | None


class EntrySpan(NamedTuple):
    """A span of entries of one message, and the innermost length-prefixed bytes (`box`) around it."""

    start: int
    end: int
    box: LengthPrefix | None


class FieldEntry(NamedTuple):
    """One entry of a field, and the part that contains it."""

    entry: WireField
    part: EntrySpan

    @property
    def inner(self) -> LengthPrefix:
        """The entry itself as length-prefixed bytes."""
        outer = self.part.box
        return LengthPrefix(self.entry.value, self.entry.body, self.entry.end, outer.depth + 1 if outer else 0, outer)


class Slot(NamedTuple):
    """The place of one scalar, without its length prefix, which belongs to `box`."""

    start: int
    end: int
    box: LengthPrefix | None


def whole(data: bytes) -> tuple[EntrySpan, ...]:
    """Return the parts of a payload's message."""
    return (EntrySpan(0, len(data), None),)


def found_of(data: bytes, layout: Layout, parts: Sequence[EntrySpan], field: ProtobufField) -> Sequence[FieldEntry]:
    """Return the entries of one field, in the order on the wire; errors as in `fields_of`."""
    return fields_of(data, layout, parts, layout.rivals(field)).get(field.number, ())


def fields_of(
    data: bytes, layout: Layout, parts: Sequence[EntrySpan], numbers: Container[int] | None = None
) -> dict[int, list[FieldEntry]]:
    """Return the entries of each known field by its number, in the order on the wire; skip all other entries.

    Args:
        numbers: Numbers of the wanted fields, and of all fields in oneofs with them; None for all.

    Raises:
        PayloadError: The bytes are not valid entries.
    """
    found: dict[int, list[FieldEntry]] = {}
    chosen: dict[int, int] = {}
    known = layout.numbers
    for part in parts:
        for entry in entries(data, part.start, part.end, known if numbers is None else numbers):
            field = known[entry.number]
            if not _fits(field, entry.wire):
                continue
            if field.oneof >= 0:
                other = chosen.get(field.oneof, entry.number)
                if other != entry.number:
                    found.pop(other, None)
                chosen[field.oneof] = entry.number
            found.setdefault(entry.number, []).append(FieldEntry(entry, part))
    return found


def _fits(field: ProtobufField, wire: int) -> bool:
    if field.kind is None:
        return wire in (BYTES, GROUP)
    return wire == field.kind.wire or (field.repeated and wire == BYTES)


def part_of(one: FieldEntry) -> EntrySpan:
    """Return the contents of a message."""
    return EntrySpan(*slot_of(one))


def slot_of(one: FieldEntry) -> Slot:
    """Return the place of a scalar that is not packed."""
    entry = one.entry
    return Slot(entry.body, entry.end, one.inner if entry.wire == BYTES else one.part.box)


def packed(field: ProtobufField, one: FieldEntry) -> bool:
    """Return whether an entry holds packed elements of an array."""
    return field.kind is not None and field.kind.wire != BYTES and one.entry.wire == BYTES


def count(data: bytes, field: ProtobufField, found: Sequence[FieldEntry]) -> int:
    """Return the number of elements of an array."""
    return sum(size(data, field, one) for one in found)


def size(data: bytes, field: ProtobufField, one: FieldEntry) -> int:
    """Return the number of elements of an array in one entry."""
    if not packed(field, one):
        return 1
    assert field.kind is not None
    start, end = one.entry.body, one.entry.end
    if field.kind.size:
        number, rest = divmod(end - start, field.kind.size)
        if rest:
            raise PayloadError(f"{end - start} bytes are not a whole number of elements", where=field.name)
        return number
    if end > start and data[end - 1] >= 0x80:
        raise PayloadError(f"the last packed element is cut off at byte {end}", where=field.name)
    return end - start - len(data[start:end].translate(None, _ENDS_VARINT))


def elements(data: bytes, field: ProtobufField, found: Sequence[FieldEntry], most: int) -> Iterator[FieldEntry | Slot]:
    """Yield at most `most` elements of an array: scalars as slots, messages as entries."""
    left = most
    for one in found:
        if left <= 0:
            return
        if field.kind is None:
            yield one
            left -= 1
        elif not packed(field, one):
            yield slot_of(one)
            left -= 1
        else:
            for slot in _slots(data, field, one, 0, min(left, size(data, field, one))):
                yield slot
                left -= 1


def element(data: bytes, field: ProtobufField, found: Sequence[FieldEntry], index: int) -> FieldEntry | Slot:
    """Return one element of an array; raise PayloadError if there is none with this index."""
    left = index
    for one in found if index >= 0 else ():
        here = size(data, field, one)
        if left < here:
            if field.kind is None:
                return one
            return next(_slots(data, field, one, left, 1)) if packed(field, one) else slot_of(one)
        left -= here
    raise PayloadError(f"no element {index} in an array of {count(data, field, found)}")


def last(data: bytes, field: ProtobufField, one: FieldEntry) -> Slot:
    """Return the last element of a packed entry that is not empty."""
    return next(_slots(data, field, one, size(data, field, one) - 1, 1))


def _slots(data: bytes, field: ProtobufField, one: FieldEntry, first: int, number: int) -> Iterator[Slot]:
    """Yield `number` elements of a packed entry from `first` on; the entry has to contain them."""
    assert field.kind is not None
    at, end, box = one.entry.body, one.entry.end, one.inner
    width = field.kind.size
    if width:
        at += first * width
        for start in range(at, at + number * width, width):
            yield Slot(start, start + width, box)
        return
    for place in range(first + number):
        start, at = at, read_varint(data, at, end)[1]
        if place >= first:
            yield Slot(start, at, box)
