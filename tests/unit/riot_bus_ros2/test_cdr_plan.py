from __future__ import annotations

import struct
from typing import Any

import pytest

from riot_bus.types.model import parse_path
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.cdr_layout import COUNT_LE, compile_type
from riot_bus_ros2.cdr_plan import find_way, make_plan
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.store import TypeStore

DEFINITION = f"""
uint8 first
float64[3] fixed
string text
uint16[] list
B one
B[] many
B[2] two
wstring odd
uint8 beyond
{"=" * 80}
MSG: p/B
int32 x
string s
int16 y
"""


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value) + 1) + value + b"\0"


def payload() -> tuple[bytes, dict[str, int]]:
    """Return a payload, and where its fields are, made field by field."""
    data, places = bytearray(b"\0\1\0\0"), dict[str, int]()

    def put(path: str, size: int, value: bytes) -> None:
        data.extend(bytes(-(len(data) - 4) % size))
        places[path] = len(data)
        data.extend(value)

    def inner(path: str, number: int) -> None:
        put(f"{path}.x", 4, struct.pack("<i", number))
        put(f"{path}.s", 4, text(b"s" * number))
        put(f"{path}.y", 2, struct.pack("<h", -number))

    put("first", 1, b"\7")
    for index in range(3):
        put(f"fixed[{index}]", 8, struct.pack("<d", index))
    put("text", 4, text(b"abcd"))
    put("len(list)", 4, struct.pack("<I", 3))
    for index in range(3):
        put(f"list[{index}]", 2, struct.pack("<H", index))
    inner("one", 1)
    put("len(many)", 4, struct.pack("<I", 3))
    for index in range(3):
        inner(f"many[{index}]", index)
    for index in range(2):
        inner(f"two[{index}]", 5 + index)
    return bytes(data), places


DATA, PLACES = payload()
ROOT: Any = compile_type("p/msg/A", TypeStore(parse_msg(DEFINITION, "p/msg/A")), outer=(), done={})


def locate(path: str, data: bytes = DATA) -> int:
    return make_plan(find_way(ROOT, parse_path(path), path)).locate(data, COUNT_LE)


@pytest.mark.parametrize("path", [path for path in PLACES if not path.startswith("len(")])
def test_each_field_is_where_it_was_put(path: str) -> None:
    assert locate(path) == PLACES[path]


def test_what_is_before_any_field_of_variable_size_needs_no_steps() -> None:
    plan = make_plan(find_way(ROOT, parse_path("fixed[2]"), "fixed[2]"))
    assert (plan.start, plan.steps) == (PLACES["fixed[2]"], ())


@pytest.mark.parametrize("path", ["list[3]", "many[3].x", "list[18446744073709551615]"])
def test_elements_that_only_this_payload_lacks_are_missed_on_the_way(path: str) -> None:
    with pytest.raises(PayloadError, match=r"no element \d+ in a sequence of 3"):
        locate(path)


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("frist", "no field 'frist'"),
        ("first.x", "no field 'x' here"),
        ("one[0]", "no field 0 here"),
        ("fixed[3]", "no element 3 in an array of 3"),
        ("list[-1]", "no element -1"),
        ("list", "this field is an array"),
        ("len(text)", "this field is no array"),
        ("one", "a message is not a scalar field"),
        ("odd", "opaque: wstring is not supported"),
        ("beyond", "opaque: wstring is not supported"),
    ],
)
def test_paths_that_no_payload_has(path: str, reason: str) -> None:
    with pytest.raises(PayloadError, match=reason):
        find_way(ROOT, parse_path(path), path)


def test_types_with_many_parts_are_found_all_the_same() -> None:
    count = 100
    text_ = "".join(f"string s{number}\nuint8 u{number}\n" for number in range(count))
    root: Any = compile_type("p/msg/A", TypeStore(parse_msg(text_, "p/msg/A")), outer=(), done={})
    data = b"\0\1\0\0" + (text(b"ab") + b"\1") * count
    for number in (0, 50, 99):
        plan = make_plan(find_way(root, parse_path(f"u{number}"), ""))
        assert plan.locate(data, COUNT_LE) == 4 + 8 * number + 7
