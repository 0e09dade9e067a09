from __future__ import annotations

import math
import struct
from typing import Any

import pytest

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_mavlink.definitions import FieldText, make_message
from riot_bus_mavlink.slots import find_slot, slots_of

MESSAGE = make_message(
    1,
    "SAMPLE",
    [
        FieldText("small", "int8_t"),
        FieldText("text", "char", 4),
        FieldText("list", "uint16_t", 2),
        FieldText("real", "float"),
        FieldText("late", "uint32_t", extension=True),
    ],
)
SLOTS = slots_of(MESSAGE)
BODY = struct.pack("<fHHb4sI", 1.5, 10, 20, -3, b"ab\0c", 7)


def test_every_value_is_read_where_the_wire_has_it() -> None:
    values = {path: slot.read(BODY) for path, slot in SLOTS.items()}
    assert values == {"small": -3, "text": "ab", "list[0]": 10, "list[1]": 20, "real": 1.5, "late": 7}
    assert list(values) == ["small", "text", "list[0]", "list[1]", "real", "late"]


def test_zeros_that_were_cut_off_are_read_as_such() -> None:
    assert SLOTS["late"].read(BODY[:-3]) == 7
    assert [slot.read(BODY[:5]) for slot in SLOTS.values()] == [0, "", 10, 0, 1.5, 0]


@pytest.mark.parametrize(
    ("path", "value", "kept"),
    [
        ("small", 127, 127),
        ("small", 128, -128),
        ("small", -129, 127),
        ("small", 2.9, 2),
        ("small", True, 1),
        ("list[1]", -1, 65535),
        ("late", 1 << 32, 0),
        ("real", 1e300, math.inf),
        ("real", -1e300, -math.inf),
        ("real", 10**400, math.inf),
        ("text", "abcdef", "abcd"),
        ("text", "", ""),
        ("text", "a\0b", "a"),
        ("text", "\udcff", "\udcff"),
    ],
)
def test_values_wrap_or_are_cut_to_their_place(path: str, value: Any, kept: object) -> None:
    slot = SLOTS[path]
    packed = slot.pack(value)
    assert len(packed) == slot.end - slot.offset
    assert slot.read(BODY[: slot.offset] + packed + BODY[slot.end :]) == kept


@pytest.mark.parametrize(
    ("path", "value"),
    [("small", math.nan), ("small", math.inf), ("small", "3"), ("real", b"3"), ("text", 3), ("text", "\ud800")],
)
def test_values_of_another_kind_are_refused(path: str, value: Any) -> None:
    with pytest.raises(PayloadError) as error:
        SLOTS[path].pack(value)
    assert error.value.where == path


def test_a_path_leads_to_a_value_or_to_the_array_whose_length_it_is() -> None:
    assert find_slot(SLOTS, MESSAGE, "list[1]") is SLOTS["list[1]"]
    assert find_slot(SLOTS, MESSAGE, "len(list)") is MESSAGE.places["list"]


@pytest.mark.parametrize("path", ["list", "list[2]", "len(text)", "len(small)", "smal", "len(list[0])"])
def test_other_paths_lead_nowhere(path: str) -> None:
    with pytest.raises(PayloadError, match="no such field"):
        find_slot(SLOTS, MESSAGE, path)
