from __future__ import annotations

import math
import struct
from typing import Any

import pytest

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.cdr_layout import (
    COUNT_BE,
    COUNT_LE,
    ORIGIN,
    Array,
    Number,
    Opaque,
    Struct,
    Text,
    compile_type,
    length_of,
    skip_elements,
)
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.store import TypeStore

NONE = dict[str, Any]().get
"""A source that knows no type."""
HEAD = b"\0\1\0\0"
INNER = "=" * 80 + "\nMSG: p/B\n"


def layout(text: str, name: str = "p/msg/A") -> Any:
    return compile_type(name, TypeStore(parse_msg(text, name), sources=[NONE]), outer=(), done={})


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value) + 1) + value + b"\0"


def end(text_: str, data: bytes) -> int:
    """Return where a message ends whose payload begins with this."""
    return int(layout(text_).skip(HEAD + data + b"\xff" * 16, ORIGIN, COUNT_LE)) - ORIGIN


@pytest.mark.parametrize(
    ("definition", "data"),
    [
        ("uint8 a\nfloat64 b", bytes(16)),
        ("uint8 a\nint16 b\nint32 c", bytes(8)),
        ("uint8[3] a\nuint16[2] b", bytes(8)),
        ("float64[2] a\nuint8 b", bytes(17)),
        ("string a\nuint8 b", text(b"ab") + b"\1"),
        ("string a\nint64 b", text(b"ab") + b"\0" + bytes(8)),
        ("int32[] a\nuint8 b", b"\2\0\0\0" + bytes(9)),
        ("float64[] a", b"\0\0\0\0"),
        ("float64[] a", b"\1\0\0\0" + bytes(4) + bytes(8)),
        ("string[2] a", text(b"a") + b"\0\0" + text(b"") + b""),
        ("string[] a\nuint16 b", b"\1\0\0\0" + text(b"abc") + b"\1\1"),
        ("B b\nint64 c\n" + INNER + "uint8 x\nuint16 y", bytes(16)),
        ("B[] b\n" + INNER + "uint16 x\nuint8 y", b"\3\0\0\0" + bytes(11)),
        ("B[2] b\n" + INNER + "string x\nuint8 y", text(b"") + b"\1" + b"\0\0" + text(b"abc") + b"\1"),
        ("", b"\0"),
    ],
)
def test_fields_are_aligned_to_their_size(definition: str, data: bytes) -> None:
    assert end(definition, data) == len(data)


def test_what_has_a_fixed_size_is_crossed_in_one_jump() -> None:
    inner = "B[1000] b\n" + INNER + "uint8 x\nfloat64[3] y\nuint8 z"
    found = layout(inner)
    assert found.jump is not None
    assert found.jump.over(ORIGIN, 1) - ORIGIN == 999 * 32 + 33
    assert layout("string a").jump is layout("uint8[] a").jump is None
    assert layout("string[0] a\nuint8 b").jump is not None


@pytest.mark.parametrize("start", range(4, 12))
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_many_elements_are_as_far_as_one_after_the_other(start: int, count: int) -> None:
    node = layout("uint8 a\nint32 b\nuint16 c")
    step = start
    for _ in range(count):
        step = node.skip(b"", step, COUNT_LE)
    assert node.jump.over(start, count) == skip_elements(node, count, b"", start, COUNT_LE) == step


@pytest.mark.parametrize("count", [COUNT_LE, COUNT_BE])
@pytest.mark.parametrize(
    ("base", "value", "kept"),
    [
        ("int8", 200, -56),
        ("uint16", -1, 65535),
        ("int64", 1 << 63, -(1 << 63)),
        ("int32", 2.9, 2),
        ("byte", 255, 255),
        ("float32", 1e300, math.inf),
        ("float64", -(10**400), -math.inf),
        ("bool", True, True),
    ],
)
def test_numbers_wrap_in_both_byte_orders(count: Any, base: str, value: Any, kept: object) -> None:
    node = Number(base)
    data = node.pack(count, value)
    assert len(data) == node.size
    assert node.read(b"...." + data, 4, count) == kept


def test_byte_order_is_that_of_the_payload() -> None:
    assert (Number("uint16").pack(COUNT_LE, 1), Number("uint16").pack(COUNT_BE, 1)) == (b"\1\0", b"\0\1")


@pytest.mark.parametrize(
    ("base", "value"), [("int8", "1"), ("float64", b"1"), ("int8", math.nan), ("uint64", math.inf)]
)
def test_values_of_another_kind_are_refused(base: str, value: Any) -> None:
    with pytest.raises(PayloadError, match="is not of type"):
        Number(base).pack(COUNT_LE, value)


def test_texts_end_with_a_zero_inside_of_the_payload() -> None:
    assert Text().read(text("é\udcff".encode(errors="surrogateescape")), 0, COUNT_LE) == "é\udcff"
    assert Text().read(b"\0\0\0\0", 0, COUNT_LE) == ""  # as some write it
    for data in (b"\2\0\0\0ab", b"\3\0\0\0a\0"):
        with pytest.raises(PayloadError, match="not terminated"):
            Text().read(data, 0, COUNT_LE)


def test_lengths_are_aligned_too() -> None:
    data = b"....?\0\0\0\7\0\0\0"
    assert length_of(Array(Number("uint8"), None), data, 5, COUNT_LE) == (7, 12)
    assert length_of(Array(Number("uint8"), 3), data, 5, COUNT_LE) == (3, 5)


@pytest.mark.parametrize(
    ("definition", "reason"),
    [
        ("nowhere/C c", "type nowhere/msg/C is unknown"),
        ("A a", "contains itself"),
        ("wstring a", "wstring is not supported"),
    ],
)
def test_opaque_parts_tell_why_but_only_where_they_have_to_be_crossed(definition: str, reason: str) -> None:
    found = layout(f"uint8 x\n{definition}\nuint8 y")
    assert isinstance(found, Struct)
    assert isinstance(found.fields["x"], Number)
    assert isinstance(next(node for name, node in found.fields.items() if name not in "xy"), Opaque)
    with pytest.raises(PayloadError, match=f"opaque: .*{reason}"):
        found.skip(HEAD + bytes(64), ORIGIN, COUNT_LE)
    assert isinstance(compile_type("p/msg/Z", TypeStore(sources=[NONE]), outer=(), done={}), Opaque)
