import re
import sys
from pathlib import Path

import cbor2
import pytest

from riot_bus.types.codecs import Codecs
from riot_bus.types.json_type import JsonType
from riot_bus.types.model import Schema
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError, install_hint
from tests.unit.types.proto_samples import SET, every

SET_DATA = SET.SerializeToString()
PAYLOAD = every().SerializeToString()


class Mine(JsonType):
    name = "mine"


class MineTypes:
    """A source of types for a codec of its own."""

    name = "mine"

    def __init__(self):
        self.files = []

    def load(self, files):
        self.files += files

    def type_named(self, type_name):
        return Mine() if type_name == "Mine" and self.files else None

    def type_of_schema(self, schema):
        return Mine() if schema.encoding == "mineschema" else None


@pytest.fixture
def plugin(monkeypatch, installed):
    """Return a function that installs codecs as entry points; the module counts how often it is imported."""
    module = type(sys)("a_codec_of_others")
    module.Mine, module.MineTypes, module.Nothing = Mine, MineTypes, object
    monkeypatch.setitem(sys.modules, module.__name__, module)

    def install(**targets):
        installed("riot_bus.types", **{name: f"{module.__name__}:{target}" for name, target in targets.items()})

    return install


@pytest.mark.parametrize(
    ("encoding", "name"),
    [
        ("cbor", "cbor"),
        ("application/cbor", "cbor"),
        ("application/x-cbor", "cbor"),
        ("application/vnd.msgpack", "msgpack"),
        ("text/json", "json"),
        ("Application/JSON", "json"),
        ("application/x-protobuf", "protobuf"),
        ("application/vnd.google.protobuf", "protobuf"),
        ("raw", "raw"),
    ],
)
def test_encodings(encoding, name):
    assert Codecs().of_encoding(encoding).name == name


@pytest.mark.parametrize("encoding", ["", "zenoh/bytes", "application/", "application/xml", "cdr"])
def test_other_encodings(encoding):
    assert Codecs().of_encoding(encoding) is None


def test_built_in_codecs_need_no_installation(installed):
    installed("riot_bus.types")
    assert Codecs().names() == ["cbor", "json", "msgpack", "protobuf", "raw"]


def test_a_codec_of_others_is_loaded_when_something_names_it(plugin):
    plugin(mine="Mine", broken="NoSuchName")
    registry = TypeRegistry(declared={"a/**": "mine"})
    assert registry.type_of("a/b").name == "mine"
    assert TypeRegistry().type_of("x", encoding="application/mine").name == "mine"
    assert "mine" in TypeRegistry().type_names()


def test_a_source_of_others(plugin):
    plugin(mine="MineTypes")
    registry = TypeRegistry(declared={"a": "Mine"}, definitions=[Path("types.mine")])
    assert registry.type_of("a").name == "mine"
    assert registry.type_of("b", encoding="application/mine;Mine").name == "mine"
    assert registry.add_schema("c", Schema("Mine", "mineschema", b""), "mine").name == "mine"
    assert TypeRegistry().type_of("b", encoding="application/mine;Mine") is None


@pytest.mark.parametrize(
    ("target", "message"), [("NoSuchName", "cannot be loaded"), ("Nothing", "neither a MessageType")]
)
def test_a_broken_codec_is_an_error_where_it_is_declared_and_opaque_elsewhere(plugin, target, message):
    plugin(mine=target)
    with pytest.raises(ConfigError, match=message):
        TypeRegistry(declared={"a": "mine"})
    kind = TypeRegistry().type_of("a", encoding="application/mine")
    assert message in kind.opaque(b"")


def test_unknown_codecs():
    with pytest.raises(ConfigError, match="did you mean 'cbor'"):
        TypeRegistry(declared={"a": "cbo"})
    with pytest.raises(ConfigError, match="unknown codec"):
        Codecs().load("nothing")


def test_cbor_by_encoding_declaration_and_log():
    payload = cbor2.dumps({"a": 1})
    by_log = TypeRegistry()
    by_log.add_schema("k", Schema("", "", b""), "cbor")
    for kind in (
        TypeRegistry(declared={"k": "cbor"}).type_of("k"),
        TypeRegistry().type_of("k", encoding="application/cbor"),
        by_log.type_of("k"),
    ):
        assert kind.read(payload, "a") == 1


def test_protobuf_by_file_encoding_and_log(tmp_path):
    pytest.importorskip("google.protobuf")
    file = tmp_path / "types.binpb"
    file.write_bytes(SET_DATA)
    registry = TypeRegistry(declared={"k": "test.Every"}, definitions=[file])
    assert registry.type_of("k").read(PAYLOAD, "f_int32") == 300
    assert registry.type_of("other", encoding="application/protobuf;test.Every").read(PAYLOAD, "at.x") == 1.0
    assert registry.type_of("other", encoding="application/protobuf") is None
    assert {"test.Every", "cbor"} <= set(registry.type_names())
    by_log = TypeRegistry()
    assert by_log.add_schema("k", Schema("test.Every", "protobuf", SET_DATA), "protobuf").name == "test.Every"
    assert by_log.type_of("k").read(PAYLOAD, "f_int32") == 300
    assert by_log.add_schema("l", Schema("test.Every", "protobuf", b"broken"), "protobuf") is None


def test_protobuf_without_the_library(monkeypatch, tmp_path):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=re.escape(install_hint("protobuf"))):
        TypeRegistry(definitions=[tmp_path / "types.desc"])
    kind = TypeRegistry().type_of("k", encoding="application/protobuf;test.Every")
    assert install_hint("protobuf") in kind.opaque(b"")
    registry = TypeRegistry()
    assert "not installed" in registry.add_schema("k", Schema("test.Every", "protobuf", SET_DATA), "protobuf").opaque(
        b""
    )


def test_structures_are_declared_by_their_layout():
    kind = TypeRegistry(declared={"imu/raw": "raw(uint32 seq, float32[3] gyro)"}).type_of("imu/raw")
    assert kind.read(b"\x05" + bytes(15), "seq") == 5
    with pytest.raises(ConfigError, match="does not describe a field"):
        TypeRegistry(declared={"imu/raw": "raw(nonsense)"})


def test_what_a_peer_calls_its_type_is_no_error_and_not_kept():
    registry = TypeRegistry()
    assert registry.type_of("k", encoding="application/xml;raw(nonsense)") is None
    for index in range(5):
        assert registry.type_of("k", encoding=f"application/xml;raw(uint8 a{index})") is not None
    assert not [name for name in registry._types if name.startswith("raw(")]
    for index in range(100):  # what they take is what their names take
        encoding = f"application/xml;raw({', '.join(f'uint8[999] a{index}_{field}' for field in range(20))})"
        assert registry.type_of("k", encoding=encoding).opaque(b"") is not None
        assert encoding not in registry._encoded
    assert len(registry._encoded) == 6


class FilesOfOthers:
    """An adapter that takes any file."""

    name = "others"

    def __init__(self):
        self.files = []

    def load(self, files):
        self.files += files

    def topic(self, key):
        return None

    def key_expression(self, topic):
        return None

    def type_named(self, type_name):
        return None

    def type_of_schema(self, schema):
        return None


def test_files_go_to_whom_they_belong(tmp_path):
    file = tmp_path / "types.desc"
    file.write_bytes(SET_DATA)
    adapter = FilesOfOthers()
    registry = TypeRegistry([adapter], definitions=[Path("pkg/msg/A.msg"), file, Path("pkg")])
    assert adapter.files == [Path("pkg/msg/A.msg"), Path("pkg")]
    assert registry.type_named("test.Every").name == "test.Every"
