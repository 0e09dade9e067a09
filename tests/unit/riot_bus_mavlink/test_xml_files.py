from __future__ import annotations

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_mavlink.definitions import Param
from riot_bus_mavlink.xml_files import DialectFile, parse_dialect

ENTITY = '<!DOCTYPE mavlink [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><mavlink><include>&b;</include></mavlink>'


def read(inside: str) -> DialectFile:
    return parse_dialect(f"<mavlink>{inside}</mavlink>".encode(), where="own.xml")


def message(*fields: str, number: str = "1", name: str = "X") -> str:
    return f'<messages><message id="{number}" name="{name}">{"".join(fields)}</message></messages>'


def enum(*entries: str) -> str:
    return f'<enums><enum name="E" bitmask="true">{"".join(entries)}</enum></enums>'


def test_a_field_has_all_that_the_file_says() -> None:
    told = 'units="cdeg" enum="E" display="bitmask" invalid="UINT16_MAX" minValue="-1.5" maxValue="1e3"'
    places = read(message(
        f'<field type="uint16_t[3]" name="a" {told}>Text.</field>',
        '<field type="uint8_t_mavlink_version" name="b"/>',
        "<extensions/>",
        '<field type="float" name="c"/>',
        '<field type="int32" name="d"/>',
    )).messages[0].places  # fmt: skip
    a, b, c, d = (place.field for place in places.values())
    assert (a.type, a.array, a.unit, a.enum, a.bitmask, a.invalid, a.low, a.high) == (
        "uint16_t", 3, "cdeg", "E", True, "UINT16_MAX", -1.5, 1000.0,
    )  # fmt: skip
    assert (b.type, b.extension, b.low, b.bitmask) == ("uint8_t", False, None, False)
    assert [(each.type, each.extension) for each in (c, d)] == [("float", True), ("int32_t", True)]


def test_values_of_an_enum_count_on_and_may_be_powers_or_hexadecimal() -> None:
    entries = (
        '<entry name="A"/>',
        '<entry value="2**4" name="B"/>',
        '<entry name="C"/>',
        '<entry value="0x20" name="D"/>',
    )
    table = read(enum(*entries)).enums[0]
    assert ({value: entry.name for value, entry in table.entries.items()}, table.bitmask) == (
        {0: "A", 16: "B", 17: "C", 32: "D"},
        True,
    )


def test_parameters_of_a_command() -> None:
    params = '<param index="1" label="Hold" units="s" minValue="0" increment="0.5"/><param index="7" reserved="true"/>'
    (entry,) = read(enum(f'<entry value="16" name="GO">{params}</entry>')).enums[0].entries.values()
    assert list(entry.params) == [
        Param(1, label="Hold", unit="s", low=0.0, increment=0.5),
        Param(7, reserved=True),
    ]


def test_includes_are_told_but_not_read() -> None:
    assert read("<include> a.xml\n</include><include>b.xml</include>").includes == ["a.xml", "b.xml"]


FIELD = '<field type="uint8_t" name="x"/>'


@pytest.mark.parametrize(
    ("inside", "reason"),
    [
        (message(FIELD, number="16777216"), "16777216 is not an id"),
        (message(FIELD, number="-1"), "-1 is not an id"),
        (message(FIELD, number=""), "not an integer"),
        (message(FIELD, number="1" * 5000), "not an integer"),
        (message(FIELD, name="X Y"), "has the name 'X Y'"),
        (message(FIELD, FIELD), "message X: two fields are called 'x'"),
        (message('<field type="uint9_t" name="x"/>'), "x has type 'uint9_t'"),
        (message('<field type="uint8_t[0]" name="x"/>'), "has type"),
        (message('<field type="uint8_t[256]" name="x"/>'), "has type"),
        (message('<field type="uint8_t" name="x" minValue="few"/>'), "minValue='few' of 'x' is not a number"),
        (message('<field type="uint64_t[32]" name="x"/>'), "256 bytes of 255"),
        (enum('<entry value="one" name="A"/>'), "A of E is 'one'"),
        (enum('<entry value="1" name=""/>'), "has the name ''"),
        (enum('<entry value="1" name="A"><param index="x"/></entry>'), "the index of a parameter"),
        ("<messages>", "mismatched tag"),
    ],
)  # fmt: skip
def test_impossible_definitions_are_told_with_their_place(inside: str, reason: str) -> None:
    with pytest.raises(ConfigError, match="not a dialect of MAVLink") as error:
        read(inside)
    assert reason in error.value.message
    assert error.value.where == "own.xml"


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff",
        b"<other/>",
        b"<?xml version='1.0' encoding='nothing'?><mavlink/>",
        ENTITY.encode(),
        b" " * (1 << 25),
    ],
    ids=["empty", "binary", "root", "encoding", "entities", "large"],
)
def test_other_files_are_refused(data: bytes) -> None:
    with pytest.raises(ConfigError):
        parse_dialect(data, where="own.xml")
