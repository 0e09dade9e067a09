from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_protobuf.source import ProtobufTypes
from tests.unit.types.proto_samples import SET, add, descriptor_pb2


def one(field: str) -> bytes:
    """Return a set with a message `own.One` that has a field of this name."""
    found = descriptor_pb2.FileDescriptorSet()
    file = found.file.add(name="own.proto", package="own", syntax="proto3")
    add(file.message_type.add(name="One"), field, 1, "int32")
    return bytes(found.SerializeToString())


def write(folder: Path, name: str, data: bytes) -> Path:
    (folder / name).write_bytes(data)
    return folder / name


def first_field(types: ProtobufTypes) -> str:
    kind = types.type_named("own.One")
    assert kind is not None
    return kind.fields()[0].path


def test_files_add_up_and_the_last_of_the_same_name_counts(tmp_path: Path) -> None:
    types = ProtobufTypes()
    assert types.type_named("own.One") is None
    types.load([write(tmp_path, "a", one("old")), write(tmp_path, "all", SET.SerializeToString())])
    assert first_field(types) == "old"
    assert types.type_named(".own.One") is types.type_named("own.One")
    assert {"own.One", "test.Every"} <= set(types.type_names())
    types.load([write(tmp_path, "b", one("new"))])
    assert first_field(types) == "new"
    assert types.type_named("test.Every") is not None


def test_the_definition_of_a_log_wins_over_files(tmp_path: Path) -> None:
    types = ProtobufTypes()
    types.load([write(tmp_path, "a", one("file"))])
    schema = Schema("own.One", "protobuf", one("log"))
    kind = types.type_of_schema(schema)
    assert kind is not None
    assert (kind.fields()[0].path, kind.schema) == ("log", schema)
    assert types.type_of_schema(schema) is kind
    assert first_field(types) == "file"


@pytest.mark.parametrize(
    "schema",
    [
        Schema("own.One", "ros2msg", one("x")),
        Schema("own.Two", "protobuf", one("x")),
        Schema("own.One", "protobuf", b"\xff"),
        Schema("own.One", "protobuf", b""),
    ],
)
def test_other_schemas(schema: Schema) -> None:
    assert ProtobufTypes().type_of_schema(schema) is None


def test_files_that_are_none_are_told_with_how_to_make_them(tmp_path: Path) -> None:
    types = ProtobufTypes()
    with pytest.raises(ConfigError, match="cannot read the definition: No such file"):
        types.load([tmp_path / "nothing"])
    with pytest.raises(ConfigError, match="FileDescriptorSet") as error:
        types.load([write(tmp_path, "a", b"message One {}")])
    assert "protoc" in str(error.value.hint)
    assert error.value.where == str(tmp_path / "a")
