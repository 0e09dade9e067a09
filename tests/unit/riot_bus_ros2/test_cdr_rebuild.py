"""What other tests compare with codecs; here are the edges of it."""

import struct

import pytest

from riot_bus.types.model import MOST_BYTES
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.store import TypeStore

LINE = "=" * 80


def define(text):
    return CdrType("pkg/msg/Test", TypeStore(parse_msg(text, "pkg/msg/Test")))


def values(kind, payload):
    return {leaf.path: leaf.value for leaf in kind.leaves(payload, elements=1000)}


NUMBERS = define("uint8 before\nfloat64[] x\nint16 after\n")
PAYLOAD = b"\0\1\0\0" + struct.pack("<B3xI2dh", 7, 2, 1.5, 2.5, -1)


@pytest.mark.parametrize("length", [0, 1, 2, 3, 17, 1000])
def test_lengths(length):
    found = values(NUMBERS, NUMBERS.rebuild(PAYLOAD, {"len(x)": length}))
    expected = {f"x[{index}]": (1.5, 2.5)[min(index, 1)] for index in range(length)}
    assert found == {"before": 7, "len(x)": length, **expected, "after": -1}


def test_lengths_come_before_values_and_outer_ones_before_inner_ones():
    kind = define(f"Inner[] a\nuint8 z\n{LINE}\nMSG: pkg/Inner\nfloat64[] x\nstring s\n")
    payload = b"\0\1\0\0" + struct.pack("<I", 0) + b"\5"
    found = kind.rebuild(payload, {"a[1].s": "text", "a[1].x[2]": 4.0, "len(a[1].x)": 3, "len(a)": 2, "z": 9})
    assert values(kind, found) == {
        "len(a)": 2, "len(a[0].x)": 0, "a[0].s": "", "len(a[1].x)": 3, "a[1].x[0]": 0.0, "a[1].x[1]": 0.0,
        "a[1].x[2]": 4.0, "a[1].s": "text", "z": 9,
    }  # fmt: skip


def test_the_same_length_changes_nothing():
    garbage = PAYLOAD[:5] + b"\xaa\xbb\xcc" + PAYLOAD[8:] + b"more"
    assert NUMBERS.rebuild(garbage, {"len(x)": 2}) == garbage


def test_bounds_are_not_enforced_but_arrays_stay():
    kind = define("int8[<=2] a\nstring<=3 b\nint8[2] c\n")
    payload = b"\0\1\0\0" + struct.pack("<Ib3xIb2b", 1, 5, 1, 0, 1, 2)
    found = kind.rebuild(payload, {"len(a)": 4, "b": "longer"})
    assert (kind.read(found, "len(a)"), kind.read(found, "b"), kind.read(found, "c[1]")) == (4, "longer", 2)
    with pytest.raises(PayloadError, match="always has 2 elements"):
        kind.rebuild(payload, {"len(c)": 3})


@pytest.mark.parametrize("value", [-1, 1 << 32, 2.0, True, "3"])
def test_values_that_are_no_lengths(value):
    with pytest.raises(PayloadError, match="is not a length"):
        NUMBERS.rebuild(PAYLOAD, {"len(x)": value})


@pytest.mark.parametrize("text", ["float64[] x\n", "string[] x\n", f"Inner[] x\n{LINE}\nMSG: pkg/Inner\nstring[9] a\n"])
@pytest.mark.parametrize("length", [MOST_BYTES, (1 << 32) - 1])
def test_what_gets_too_large_is_refused_at_once(text, length):
    kind = define(text)
    payload = b"\0\1\0\0" + struct.pack("<I", 0)
    with pytest.raises(PayloadError, match="over the limit"):
        kind.rebuild(payload, {"len(x)": length})
    with pytest.raises(PayloadError, match="over the limit"):
        kind.rebuild(kind.rebuild(payload, {"len(x)": 1}), {"len(x)": length})


def test_many_elements_of_different_sizes():
    kind = define(f"Inner[] x\nint64 z\n{LINE}\nMSG: pkg/Inner\nstring a\nfloat64 b\nuint8 c\n")
    payload = kind.rebuild(b"\0\1\0\0" + struct.pack("<I4xq", 0, 3), {"len(x)": 1})
    payload = kind.rebuild(payload, {"x[0].a": "abc", "x[0].b": 1.5, "x[0].c": 2})
    found = kind.rebuild(payload, {"len(x)": 100_001})
    assert kind.read(found, "x[100000].a") == "abc"
    assert kind.read(found, "x[99999].b") == 1.5
    assert kind.read(found, "z") == 3


def test_elements_without_a_size():
    kind = define(f"Inner[] x\nint64 z\n{LINE}\nMSG: pkg/Inner\nuint8[0] a\n")
    payload = b"\0\1\0\0" + struct.pack("<I4xq", 1, 3)
    found = kind.rebuild(payload, {"len(x)": (1 << 32) - 1})
    assert kind.read(found, "z") == 3
    assert len(found) == len(payload)


def test_cut_payloads():
    for end in range(4, len(PAYLOAD)):
        with pytest.raises(PayloadError):
            NUMBERS.rebuild(PAYLOAD[:end], {"after": 5, "len(x)": 2})


def test_fields_that_are_not_there():
    for changes in ({"len(y)": 3}, {"x[0].y": "text"}, {"len(x)": 1, "x[1]": 2.0}, {"len(x)": 1, "after": "text"}):
        with pytest.raises(PayloadError) as caught:
            NUMBERS.rebuild(PAYLOAD, changes)
        assert "pkg/msg/Test" in caught.value.where or caught.value.where in changes
