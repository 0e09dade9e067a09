from __future__ import annotations

from riot_bus.types.fields import MOST_FIELDS, FieldType
from riot_bus_protobuf.layout import Definitions
from riot_bus_protobuf.static import static_fields
from tests.unit.types.proto_samples import SET, add, descriptor_pb2


def listed(files: object, name: str) -> dict[str, FieldType]:
    definitions = Definitions({file.name: file for file in files})  # type: ignore[attr-defined]
    layout = definitions.layout(name)
    assert layout is not None
    found = static_fields(definitions, layout)
    assert len(found) <= MOST_FIELDS
    return {field.path: field for field in found}


def test_all_that_messages_may_have_is_listed_by_path() -> None:
    found = listed(SET.file, "test.Every")
    assert found["f_int32"] == FieldType("f_int32", "int32")
    assert found["mode"].names[2] == (-3, "BROKEN")
    assert (found["len(r_bool)"].type, found["r_bool[*]"].type) == ("uint32", "bool")
    assert (found["at.x"].unit, found["path[*].y"].unit) == ("m", "m")
    assert (found['counts["*"]'].type, found['spots["*"].x'].type) == ("int32", "float64")
    assert "len(counts)" not in found


def test_a_message_in_itself_is_listed_once() -> None:
    assert not [path for path in listed(SET.file, "test.Every") if path.startswith("inner")]


def test_messages_that_double_at_each_level_are_listed_in_part() -> None:
    file = descriptor_pb2.FileDescriptorProto(name="deep.proto", package="deep", syntax="proto3")
    for level in range(60):
        message = file.message_type.add(name=f"M{level}")
        for name in ("a", "b"):
            add(message, name, ord(name), "message", target=f".deep.M{level + 1}")
    add(file.message_type.add(name="M60"), "x", 1, "int32")
    assert len(listed([file], "deep.M50")) == 1 << 10
    assert len(listed([file], "deep.M46")) == MOST_FIELDS
