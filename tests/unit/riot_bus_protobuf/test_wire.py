from __future__ import annotations

import math
from typing import Any

import pytest

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_protobuf.wire import (
    BYTES,
    FIXED32,
    FIXED64,
    KINDS,
    VARINT,
    decode,
    encode,
    entries,
    read_varint,
    tag,
    varint,
)


class All:
    def __contains__(self, number: object) -> bool:
        return True


def read(data: bytes, numbers: Any = All()) -> list[tuple[int, bytes]]:  # noqa: B008 - has no state
    return [(each.number, data[each.body : each.end]) for each in entries(data, 0, len(data), numbers)]


@pytest.mark.parametrize("bits", range(65))
def test_varints_are_read_where_they_are(bits: int) -> None:
    for number in {(1 << bits) - 1, (1 << bits) * 2 // 3}:
        data = b"\xff\0" + varint(number) + b"\xff"
        assert read_varint(data, 2, len(data)) == (number, len(data) - 1)


@pytest.mark.parametrize(("number", "data"), [(0, b"\0"), (127, b"\x7f"), (128, b"\x80\1"), (300, b"\xac\2")])
def test_varints_are_short(number: int, data: bytes) -> None:
    assert varint(number) == data
    assert read_varint(data[:-1] + bytes([data[-1] | 0x80, 0]), 0, 9)[0] == number  # others may write more


@pytest.mark.parametrize("data", [b"", b"\x80", b"\xff" * 10, b"\xff" * 11 + b"\0"])
def test_varints_that_do_not_end(data: bytes) -> None:
    with pytest.raises(PayloadError, match="does not end"):
        read_varint(data, 0, len(data))


def test_negative_numbers_have_ten_bytes_of_which_too_much_is_cut() -> None:
    assert len(encode(KINDS["int32"], -1)) == 10
    assert decode(KINDS["int32"], b"\xff" * 9 + b"\x7f", 0, 10) == -1


def test_entries_of_all_kinds_are_skipped_or_yielded() -> None:
    group = tag(7, 3) + tag(1, VARINT) + b"\5" + tag(8, 3) + tag(8, 4) + tag(7, 4)
    data = (
        tag(1, VARINT) + varint(300) + tag(2, FIXED64) + b"8" * 8 + tag(3, BYTES) + b"\3abc"
        + group + tag(5, FIXED32) + b"4444" + tag(1000, BYTES) + b"\0"
    )  # fmt: skip
    assert read(data) == [(1, varint(300)), (2, b"8" * 8), (3, b"abc"), (7, group[1:-1]), (5, b"4444"), (1000, b"")]
    assert read(data, {3, 1000}) == [(3, b"abc"), (1000, b"")]


@pytest.mark.parametrize(
    "data",
    [
        tag(0, VARINT) + b"\0",
        tag(1 << 29, VARINT) + b"\0",
        tag(1, VARINT),
        tag(1, VARINT) + b"\x80",
        tag(1, FIXED32) + b"444",
        tag(1, BYTES) + b"\4abc",
        tag(1, 6) + b"\0",
        tag(1, 4),
        tag(1, 3) + tag(2, VARINT) + b"\0",
        tag(1, 3) + tag(2, 4),
        tag(1, 3) * 200 + tag(1, 4) * 200,
    ],
    ids=["zero", "number", "no value", "varint", "fixed", "bytes", "type", "end", "open group", "other end", "depth"],
)
def test_what_is_no_entry_is_refused_even_if_nobody_wants_it(data: bytes) -> None:
    with pytest.raises(PayloadError):
        read(data, ())


@pytest.mark.parametrize(
    ("name", "value", "kept"),
    [
        ("int32", 1 << 31, -(1 << 31)),
        ("uint32", -1, (1 << 32) - 1),
        ("sint32", (1 << 31) + 5, -(1 << 31) + 5),
        ("sint32", 0, 0),
        ("sint64", -(1 << 63), -(1 << 63)),
        ("sfixed32", 1 << 31, -(1 << 31)),
        ("fixed64", -1, (1 << 64) - 1),
        ("enum", -3, -3),
        ("bool", 7, True),
        ("int64", 2.9, 2),
        ("float", 1e300, math.inf),
        ("double", -(10**400), -math.inf),
        ("string", "é\udcff", "é\udcff"),
        ("bytes", b"\0\xff", b"\0\xff"),
    ],
)
def test_values_are_kept_or_wrapped(name: str, value: Any, kept: object) -> None:
    data = encode(KINDS[name], value)
    found = decode(KINDS[name], data, 0, len(data))
    assert (found, type(found)) == (kept, type(kept))


@pytest.mark.parametrize(
    ("name", "value"),
    [("int32", "3"), ("int32", math.nan), ("fixed32", math.inf), ("double", b"3"), ("string", 3), ("string", b"3"),
     ("bytes", "3"), ("string", "\ud800")],
)  # fmt: skip
def test_values_of_another_kind_are_refused(name: str, value: Any) -> None:
    with pytest.raises(PayloadError):
        encode(KINDS[name], value)
