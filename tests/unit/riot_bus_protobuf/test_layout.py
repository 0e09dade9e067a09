from __future__ import annotations

from typing import Any

import pytest

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_protobuf.layout import Definitions, load_set
from tests.unit.types.proto_samples import SET

DEFINITIONS = Definitions({file.name: file for file in SET.file})


def fields(name: str) -> dict[str, Any]:
    layout = DEFINITIONS.layout(name)
    assert layout is not None
    assert {field.number: field for field in layout.fields.values()} == layout.numbers
    return layout.fields


def test_names_are_those_of_messages_and_not_of_entries_of_maps() -> None:
    assert DEFINITIONS.names() == ["new.Edition", "old.Legacy", "old.Legacy.Part", "test.Every", "test.Vector"]
    assert DEFINITIONS.layout("test.Mode") is None
    counts = fields("test.Every")["counts"]
    assert DEFINITIONS.inside(counts).entry
    assert not DEFINITIONS.inside(fields("test.Every")["at"]).entry


@pytest.mark.parametrize(
    ("message", "present", "packed"),
    [
        ("test.Every", {"number", "text", "place", "maybe", "at", "inner"}, "r_int32"),
        ("old.Legacy", {"id", "note", "part"}, ""),
        ("new.Edition", {"explicit", "delimited"}, "packed"),
    ],
)
def test_presence_and_packing_depend_on_the_syntax(message: str, present: set[str], packed: str) -> None:
    found = fields(message)
    assert {name for name, field in found.items() if field.presence} == present
    assert {name for name, field in found.items() if field.packed} >= ({packed} - {""})
    assert not any(found[name].packed for name in ("unpacked", "expanded", "values", "r_string") if name in found)


def test_groups_are_those_of_proto2_and_of_editions() -> None:
    groups = {name for message in DEFINITIONS.names() for name, field in fields(message).items() if field.group}
    assert groups == {"part", "parts", "delimited", "path"}
    assert not fields("test.Every")["path"].group


def test_a_field_replaces_the_others_of_its_oneof() -> None:
    layout = DEFINITIONS.layout("test.Every")
    assert layout is not None
    assert set(layout.rivals(layout.fields["text"])) == {40, 41, 42}
    assert set(layout.rivals(layout.fields["maybe"])) == {43}
    assert set(layout.rivals(layout.fields["mode"])) == {20}


def test_enums_have_names_and_limits_and_comments_units() -> None:
    mode = fields("test.Every")["mode"]
    assert (mode.low, mode.high, mode.names) == (-3, 1, ((0, "OFF"), (1, "ON"), (-3, "BROKEN")))
    assert {name: field.unit for name, field in fields("test.Vector").items()} == {"x": "m", "y": "m", "z": ""}


@pytest.mark.parametrize(
    ("name", "default"),
    [("f_bool", False), ("f_string", ""), ("f_bytes", b""), ("f_double", 0.0), ("f_int32", 0), ("mode", 0)],
)
def test_defaults(name: str, default: object) -> None:
    found = fields("test.Every")[name].default
    assert (found, type(found)) == (default, type(default))


def test_fields_of_unknown_types_are_left_out() -> None:
    alone = Definitions({file.name: file for file in SET.file if file.name == "main.proto"}).layout("test.Every")
    assert alone is not None
    assert {"at", "path"} & alone.fields.keys() == set()
    assert {"inner", "counts", "f_int32"} <= alone.fields.keys()
    assert alone.fields["mode"].names == ()


@pytest.mark.parametrize(
    ("message", "files"),
    [("test.Every", ["base.proto", "main.proto"]), ("test.Vector", ["base.proto"]), ("old.Legacy", ["old.proto"])],
)
def test_a_set_of_one_message_has_what_it_imports_first(message: str, files: list[str]) -> None:
    assert [file.name for file in load_set(DEFINITIONS.serialized(message)).file] == files


@pytest.mark.parametrize("data", [b"", b"\xff", b"\0" * ((1 << 24) + 1)], ids=["empty", "broken", "large"])
def test_what_is_no_descriptor_set(data: bytes) -> None:
    with pytest.raises(PayloadError):
        load_set(data)
