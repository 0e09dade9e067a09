from __future__ import annotations

from typing import Any

import pytest

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_protobuf.layout import Layout, ProtobufField
from riot_bus_protobuf.walk import count, element, elements, fields_of, found_of, part_of, whole
from riot_bus_protobuf.wire import BYTES, FIXED32, KINDS, VARINT, decode, tag, varint


def field(number: int, kind: str | None, *, repeated: bool = False, oneof: int = -1) -> ProtobufField:
    scalar = KINDS[kind] if kind else None
    return ProtobufField(
        f"f{number}",
        number,
        scalar,
        "" if kind else "Inner",
        repeated,
        packed=True,
        group=False,
        presence=False,
        oneof=oneof,
    )


NUMBERS, FIXED = field(1, "int32", repeated=True), field(2, "fixed32", repeated=True)
INNER, LIST = field(3, None), field(4, None, repeated=True)
LEFT, RIGHT = field(5, "int32", oneof=0), field(6, "string", oneof=0)
LAYOUT = Layout("Outer", numbers={each.number: each for each in (NUMBERS, FIXED, INNER, LIST, LEFT, RIGHT)})


def boxed(number: int, data: bytes) -> bytes:
    return tag(number, BYTES) + varint(len(data)) + data


def found(data: bytes, one: ProtobufField) -> Any:
    return found_of(data, LAYOUT, whole(data), one)


def values(data: bytes, one: ProtobufField, most: int = 100) -> list[Any]:
    slots: Any = elements(data, one, found(data, one), most)
    assert one.kind is not None
    return [decode(one.kind, data, slot.start, slot.end) for slot in slots]


MIXED = boxed(1, b"\1\xac\2") + tag(1, VARINT) + b"\3" + boxed(1, b"") + tag(5, VARINT) + b"\0" + boxed(1, b"\4\5")


def test_elements_may_be_packed_or_not() -> None:
    assert values(MIXED, NUMBERS) == [1, 300, 3, 4, 5]
    assert count(MIXED, NUMBERS, found(MIXED, NUMBERS)) == 5
    assert [values(MIXED, NUMBERS, most) for most in (0, 1, 4)] == [[], [1], [1, 300, 3, 4]]


@pytest.mark.parametrize("index", range(5))
def test_one_element_is_the_one_of_all(index: int) -> None:
    slot: Any = element(MIXED, NUMBERS, found(MIXED, NUMBERS), index)
    assert decode(KINDS["int32"], MIXED, slot.start, slot.end) == values(MIXED, NUMBERS)[index]


@pytest.mark.parametrize("index", [-1, 5])
def test_no_element_beyond(index: int) -> None:
    with pytest.raises(PayloadError, match=f"no element {index} in an array of 5"):
        element(MIXED, NUMBERS, found(MIXED, NUMBERS), index)


def test_packed_elements_of_fixed_size_are_counted_by_their_bytes() -> None:
    data = boxed(2, b"\1\0\0\0\2\0\0\0") + tag(2, FIXED32) + b"\3\0\0\0"
    assert values(data, FIXED) == [1, 2, 3]
    with pytest.raises(PayloadError, match="not a whole number of elements"):
        values(boxed(2, b"12345"), FIXED)


def test_packed_elements_end_with_their_box() -> None:
    with pytest.raises(PayloadError, match="cut off"):
        values(boxed(1, b"\1\x80") + b"\x08\1", NUMBERS)


def test_of_a_oneof_the_last_counts() -> None:
    data = tag(5, VARINT) + b"\1" + boxed(6, b"a") + tag(5, VARINT) + b"\2"
    assert set(fields_of(data, LAYOUT, whole(data))) == {5}
    assert (len(found(data, LEFT)), list(found(data, RIGHT))) == (1, [])


def test_parts_of_a_message_are_read_as_one() -> None:
    inner = Layout("Inner", numbers={1: NUMBERS})
    data = boxed(3, tag(1, VARINT) + b"\7") + boxed(4, b"") + boxed(3, tag(1, VARINT) + b"\x08")
    parts = tuple(map(part_of, found(data, INNER)))
    inside = found_of(data, inner, parts, NUMBERS)
    assert [data[each.entry.body] for each in inside] == [7, 8]
    for each in inside:  # each knows the box whose length it is part of
        box: Any = each.part.box
        assert data[box.prefix] == box.end - box.body == 2


def test_entries_of_another_wire_type_are_not_those_of_the_field() -> None:
    data = tag(5, FIXED32) + b"1234" + tag(3, VARINT) + b"\1" + boxed(5, b"")
    assert fields_of(data, LAYOUT, whole(data)) == {}
    assert count(data, LIST, found(data, LIST)) == 0
