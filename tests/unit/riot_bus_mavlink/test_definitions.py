from __future__ import annotations

import pytest

from riot_bus_mavlink.definitions import DialectError, EnumEntry, EnumTable, FieldText, make_message

HEARTBEAT = [
    FieldText("type", "uint8_t"),
    FieldText("autopilot", "uint8_t"),
    FieldText("base_mode", "uint8_t"),
    FieldText("custom_mode", "uint32_t"),
    FieldText("system_status", "uint8_t"),
    FieldText("mavlink_version", "uint8_t"),
]


def test_the_heartbeat_is_as_the_specification_says() -> None:
    message = make_message(0, "HEARTBEAT", HEARTBEAT)
    assert (message.crc_extra, message.size, message.base_size) == (50, 9, 9)
    assert list(message.places) == [field.name for field in HEARTBEAT]
    assert message.places["custom_mode"].offset == 0
    assert [message.places[name].offset for name in ("type", "mavlink_version")] == [4, 8]


def test_arrays_are_sorted_by_their_elements_and_extensions_stay_last() -> None:
    fields = [
        FieldText("bytes", "uint8_t", 8),
        FieldText("late", "double", extension=True),
        FieldText("later", "char", 3, extension=True),
        FieldText("two", "int16_t"),
        FieldText("two_more", "uint16_t", 2),
    ]
    message = make_message(1, "X", fields)
    assert {name: (place.offset, place.end) for name, place in message.places.items()} == {
        "bytes": (6, 14),
        "late": (14, 22),
        "later": (22, 25),
        "two": (0, 2),
        "two_more": (2, 6),
    }
    assert (message.base_size, message.size) == (14, 25)


def test_extensions_do_not_count_for_the_extra_byte_but_lengths_of_arrays_do() -> None:
    extra = make_message(0, "HEARTBEAT", [*HEARTBEAT, FieldText("more", "double", extension=True)]).crc_extra
    assert extra == 50
    assert len({make_message(1, "X", [FieldText("x", "int8_t", size)]).crc_extra for size in (0, 1, 2)}) == 3


@pytest.mark.parametrize(
    ("names", "targets"),
    [((), (None, None)), (("target_system",), (1, None)), (("target_component", "target_system"), (2, 1))],
)
def test_targets_are_found_by_their_names(names: tuple[str, ...], targets: tuple[int | None, int | None]) -> None:
    fields = [FieldText("x", "uint8_t"), *(FieldText(name, "uint8_t") for name in names)]
    assert make_message(1, "X", fields).targets == targets


def test_impossible_messages() -> None:
    make_message(1, "X", [FieldText("x", "uint8_t", 255)])
    with pytest.raises(DialectError, match="256 bytes of 255"):
        make_message(1, "X", [FieldText("x", "uint8_t", 255), FieldText("y", "char", extension=True)])
    with pytest.raises(DialectError, match="two fields are called 'x'"):
        make_message(1, "X", [FieldText("x", "uint8_t"), FieldText("x", "int8_t", extension=True)])


@pytest.mark.parametrize(
    ("written", "kind", "size"),
    [("char", "string", 1), ("float", "float32", 4), ("double", "float64", 8), ("int64_t", "int64", 8)],
)
def test_names_of_types(written: str, kind: str, size: int) -> None:
    assert (FieldText("x", written).kind, FieldText("x", written, 3).size) == (kind, 3 * size)


def test_all_flags_of_a_bitmask() -> None:
    entries = {value: EnumEntry(f"E{value}", value) for value in (1, 4, 6)}
    assert EnumTable("E", bitmask=True, entries=entries).flags == 7
