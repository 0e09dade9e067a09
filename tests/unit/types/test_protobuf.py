import numpy as np
import pytest

pytest.importorskip("google.protobuf")

from google.protobuf import descriptor_pb2
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.types.capabilities import DescribesFields
from riot_bus.types.fields import FieldType
from riot_bus.types.model import REBUILD, Leaf, MessageType, Schema, TypeSource
from riot_bus.types.payloads import Payloads
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError, PayloadError
from riot_bus_protobuf.kind import ProtobufType
from riot_bus_protobuf.layout import Definitions
from riot_bus_protobuf.source import ProtobufTypes
from tests.unit.types.proto_samples import SCALARS, SET, cls, every, legacy

DEFINITIONS = Definitions({each.name: each for each in SET.file})
EVERY, LEGACY = ProtobufType("test.Every", DEFINITIONS), ProtobufType("old.Legacy", DEFINITIONS)
PAYLOAD = every().SerializeToString()
RANGES = {
    "int32": st.integers(-(1 << 31), (1 << 31) - 1),
    "int64": st.integers(-(1 << 63), (1 << 63) - 1),
    "uint32": st.integers(0, (1 << 32) - 1),
    "uint64": st.integers(0, (1 << 64) - 1),
}
RANGES |= {"sint32": RANGES["int32"], "sfixed32": RANGES["int32"], "sint64": RANGES["int64"]}
RANGES |= {"sfixed64": RANGES["int64"], "fixed32": RANGES["uint32"], "fixed64": RANGES["uint64"]}
RANGES |= {"bool": st.booleans(), "double": st.floats(allow_nan=False), "float": st.floats(width=32, allow_nan=False)}
RANGES |= {"string": st.text(max_size=200), "bytes": st.binary(max_size=200)}


def parsed(payload, name="test.Every"):
    return cls(name).FromString(payload)


def leaves(payload, kind=EVERY):
    return {leaf.path: leaf.value for leaf in kind.leaves(payload)}


def test_is_a_message_type():
    assert isinstance(EVERY, MessageType)
    assert isinstance(EVERY, DescribesFields)
    assert (EVERY.name, EVERY.encoding) == ("test.Every", "protobuf")


def test_leaves():
    found = leaves(PAYLOAD)
    assert found["f_string"] == "héllo"
    assert found["f_uint64"] == 1 << 63
    assert found["f_sint32"] == -11
    assert found["mode"] == 1
    assert found["at.y"] == 0.0  # there, though not on the wire
    assert [found[f"path[{index}].x"] for index in range(3)] == [1.0, 0.0, 0.0]
    assert found["inner.inner.f_string"] == "deep"
    assert found["counts.left"] == 1
    assert found['counts["odd key"]'] == 300
    assert found["spots[3].x"] == 4.0
    assert found["flags.true"] == "yes"
    assert found["number"] == 42
    assert found["maybe"] == 0
    assert "text" not in found
    assert "place.x" not in found
    assert "maybe" not in leaves(b"")
    assert Leaf("len(r_sint32)", "uint32", 2) in EVERY.leaves(PAYLOAD)


@pytest.mark.parametrize("kind", SCALARS)
@settings(deadline=None)
@given(data=st.data())
def test_scalars_agree_with_the_library(kind, data):
    value, values = data.draw(RANGES[kind]), data.draw(st.lists(RANGES[kind], max_size=5))
    message = cls("test.Every")(**{f"f_{kind}": value, f"r_{kind}": values})
    payload = message.SerializeToString()
    assert EVERY.read(payload, f"f_{kind}") == value
    assert [EVERY.read(payload, f"r_{kind}[{index}]") for index in range(len(values))] == values
    other = data.draw(RANGES[kind])
    changed = parsed(EVERY.rebuild(payload, {f"f_{kind}": other}))
    assert getattr(changed, f"f_{kind}") == other
    assert list(getattr(changed, f"r_{kind}")) == values
    if values:
        index = data.draw(st.integers(0, len(values) - 1))
        changed = parsed(EVERY.rebuild(payload, {f"r_{kind}[{index}]": other}))
        assert list(getattr(changed, f"r_{kind}")) == [*values[:index], other, *values[index + 1 :]]


def test_patch_changes_the_value_alone():
    patched = EVERY.patch(PAYLOAD, {"f_double": 2.5, "f_int32": 301, "inner.f_int32": 4, "r_sint32[0]": 2})
    assert len(patched) == len(PAYLOAD)
    assert sum(one != other for one, other in zip(PAYLOAD, patched, strict=True)) <= 8 + 1 + 1 + 1
    after = parsed(patched)
    assert (after.f_double, after.f_int32, after.inner.f_int32, after.r_sint32[0]) == (2.5, 301, 4, 2)


@pytest.mark.parametrize(
    "changes", [{"f_int32": 3}, {"f_string": "longer text"}, {"f_bool": False, "inner.f_bool": True}]
)
def test_patch_refuses_what_changes_sizes(changes):
    with pytest.raises(PayloadError, match="a different number of bytes") as caught:
        EVERY.patch(PAYLOAD, changes)
    assert caught.value.hint == REBUILD
    assert list(changes)[-1] in caught.value.where
    assert parsed(EVERY.rebuild(PAYLOAD, changes)) != parsed(PAYLOAD)


def test_rebuild_adds_what_is_not_on_the_wire():
    changed = parsed(
        EVERY.rebuild(b"", {"at.x": 1.5, "at.y": 2.5, "inner.inner.at.z": 3.5, "f_string": "s", "maybe": 7})
    )
    expected = cls("test.Every")(at={"x": 1.5, "y": 2.5}, inner={"inner": {"at": {"z": 3.5}}}, f_string="s", maybe=7)
    assert changed == expected


def test_rebuild_counts_all_that_is_around():
    text = "x" * 100_000
    changed = parsed(EVERY.rebuild(PAYLOAD, {"inner.inner.f_string": text, "path[1].y": 5.0, 'counts["odd key"]': 1}))
    expected = parsed(PAYLOAD)
    expected.inner.inner.f_string = text
    expected.path[1].y = 5.0
    expected.counts["odd key"] = 1
    assert changed == expected


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 300])
@pytest.mark.parametrize("name", ["r_int64", "r_double", "r_string", "path", "unpacked", "modes", "inner.r_float"])
def test_lengths_agree_with_the_library(name, count):
    changed = parsed(EVERY.rebuild(PAYLOAD, {f"len({name})": count}))
    expected = parsed(PAYLOAD)
    owner, _, last = name.rpartition(".")
    values = getattr(expected.inner if owner else expected, last)
    while len(values) > count:
        del values[-1]
    while len(values) < count:
        values.append(values[-1] if values else 0)
    assert changed == expected


def test_unknown_fields_and_the_order_of_fields_are_kept():
    unknown = b"\xa0\x7f\x05" + b"\xab\x7f\x08\x01\xac\x7f" + b"\xaa\x7f\x02hi"
    payload = b"\x72\x03abc" + unknown + b"\x28\x05" + unknown
    assert EVERY.opaque(payload) is None
    assert leaves(payload)["f_int32"] == 5
    assert EVERY.rebuild(payload, {"f_int32": 300}) == b"\x72\x03abc" + unknown + b"\x28\xac\x02" + unknown


def test_the_last_of_several_counts_and_messages_are_merged():
    first, second = cls("test.Every")(at={"x": 1.0, "y": 2.0}, f_int32=1), cls("test.Every")(at={"y": 3.0}, f_int32=2)
    payload = first.SerializeToString() + second.SerializeToString()
    found = leaves(payload)
    assert (found["f_int32"], found["at.x"], found["at.y"]) == (2, 1.0, 3.0)
    changed = parsed(EVERY.rebuild(payload, {"at.x": 5.0, "at.z": 6.0, "f_int32": 700}))
    assert (changed.at.x, changed.at.y, changed.at.z, changed.f_int32) == (5.0, 3.0, 6.0, 700)


def test_of_a_oneof_the_last_counts():
    payload = cls("test.Every")(place={"x": 1.0}).SerializeToString() + cls("test.Every")(text="t").SerializeToString()
    assert leaves(payload)["text"] == "t"
    assert "place.x" not in leaves(payload)
    with pytest.raises(PayloadError, match="not set"):
        EVERY.read(payload, "number")
    changed = parsed(EVERY.rebuild(payload, {"number": 3}))
    assert changed.WhichOneof("choice") == "number"


def test_packed_and_unpacked_may_be_mixed():
    payload = b"\xb0\x01\x01" + b"\xb2\x01\x03\x02\xac\x02" + b"\xb0\x01\x04"
    assert list(parsed(payload).unpacked) == [1, 2, 300, 4]
    assert [EVERY.read(payload, f"unpacked[{index}]") for index in range(4)] == [1, 2, 300, 4]
    for count in range(7):
        expected = [1, 2, 300, 4, 4, 4, 4][:count]
        assert list(parsed(EVERY.rebuild(payload, {"len(unpacked)": count})).unpacked) == expected
    assert list(parsed(EVERY.rebuild(payload, {"unpacked[2]": 3})).unpacked) == [1, 2, 3, 4]


def test_proto2_groups():
    payload = legacy().SerializeToString()
    assert leaves(payload, LEGACY)["part.x"] == 1.5
    changed = LEGACY.rebuild(
        payload, {"part.x": 2.0, "parts[1].x": 3.0, "len(values)": 5, "note": "nn", "len(parts)": 3}
    )
    after = parsed(changed, "old.Legacy")
    assert (after.part.x, [part.x for part in after.parts], after.note) == (2.0, [2.5, 3.0, 0.0], "nn")
    assert list(after.values) == [-1, 2, 300, 300, 300]
    empty = parsed(LEGACY.rebuild(b"", {"part.x": 1.0, "len(parts)": 2, "len(values)": 2}), "old.Legacy")
    assert (empty.part.x, len(empty.parts), list(empty.values)) == (1.0, 2, [0, 0])
    assert LEGACY.leaves(b"\x08\x01") == [
        Leaf("id", "int32", 1),
        Leaf("len(values)", "uint32", 0),
        Leaf("len(parts)", "uint32", 0),
    ]


def test_editions():
    kind = ProtobufType("new.Edition", DEFINITIONS)
    assert [leaf.path for leaf in kind.leaves(b"")] == ["implicit", "len(packed)", "len(expanded)", "len(path)"]
    changes = {
        "explicit": 1,
        "len(packed)": 3,
        "len(expanded)": 2,
        "delimited.x": 1.5,
        "len(path)": 2,
        "packed[1]": 300,
    }
    changed = kind.rebuild(b"", changes)
    after = cls("new.Edition").FromString(changed)
    expected = cls("new.Edition")(explicit=1, packed=[0, 300, 0], expanded=[0, 0], delimited={"x": 1.5}, path=[{}, {}])
    assert after == expected
    assert len(changed) == expected.ByteSize()
    assert kind.read(expected.SerializeToString(), "delimited.x") == 1.5


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("f_int33", "no field 'f_int33'"),
        ("at", "a message is not a scalar"),
        ("at.w", "no field 'w'"),
        ("f_int32.x", "this is a scalar"),
        ("path", "is an array"),
        ("path.x", "no field 'x' here"),
        ("path[3].x", "no element 3 in an array of 3"),
        ("r_double[-1]", "no element -1"),
        ("len(f_int32)", "only arrays have a length"),
        ("counts.right", "no entry 'right'"),
        ("counts", "a map is not a scalar"),
        ("place.x", "not set"),
        ("inner.maybe", "not set"),
    ],
)
def test_paths_that_lead_nowhere(path, message):
    with pytest.raises(PayloadError, match=message) as caught:
        EVERY.read(PAYLOAD, path)
    assert "test.Every" in caught.value.where


@pytest.mark.parametrize(
    ("path", "value"), [("f_int32", "3"), ("f_string", 3), ("f_bytes", "t"), ("f_bool", b"x"), ("f_int32", np.nan)]
)
def test_values_of_another_kind(path, value):
    with pytest.raises(PayloadError, match="is no"):
        EVERY.rebuild(PAYLOAD, {path: value})


@pytest.mark.parametrize(
    ("payload", "why"),
    [
        (b"\x00", "no field number"),
        (b"\xff" * 11, "varint at byte 0 does not end"),
        (b"\x09\x00", "ends beyond"),
        (b"\x72\xff\xff\xff\xff\x0f", "ends beyond"),
        (b"\x0f", "begins nothing"),
        (b"\x0c", "begins nothing"),
        (b"\x0b", "group 1 does not end"),
        (b"\x0b\x14", "byte 1 ends the group of field 2, but the open group is that of field 1"),
        (b"\x0b" * 1000, "nested deeper"),
        (b"\xaa\x06\x03abc", "not a whole number"),
        (b"\xba\x06\x01\xff", "cut off"),
    ],
)
def test_opaque_payloads(payload, why):
    assert why in EVERY.opaque(payload)


def test_nesting_is_bounded():
    payload = b""
    for _ in range(100):
        payload = cls("test.Every")(inner=parsed(payload)).SerializeToString() if len(payload) < 120 else payload
    deep = b""
    for _ in range(80):
        deep = b"\x82\x02" + bytes([len(deep) & 0x7F | 0x80, len(deep) >> 7]) + deep
    assert "nested deeper than 64" in EVERY.opaque(deep)


def test_fields():
    fields = {each.path: each for each in EVERY.fields()}
    assert fields["at.x"] == FieldType("at.x", "float64", unit="m")
    assert fields["path[*].y"].unit == "m"
    assert fields["mode"] == FieldType("mode", "int32", low=-3, high=1, names=((0, "OFF"), (1, "ON"), (-3, "BROKEN")))
    assert fields["r_float[*]"].type == "float32"
    assert fields['counts["*"]'].type == "int32"
    assert fields['spots["*"].x'].type == "float64"
    assert "inner.f_int32" not in fields  # a type inside itself is listed once
    assert fields["len(path)"].type == "uint32"


def test_elements_in_bulk():
    payloads = [PAYLOAD, b"", b"\xff"]
    buffer = b"".join(payloads)
    lengths = np.array([len(each) for each in payloads], np.int64)
    many = Payloads(buffer, np.cumsum(lengths) - lengths, lengths)
    assert [each.tolist() for each in EVERY.elements(many, "r_int64")] == [[-1, 0, 300], []]
    for path in ("r_string", "path", "f_int32", "nothing"):
        with pytest.raises(PayloadError, match="no such array of numbers"):
            EVERY.elements(many, path)


def test_types_of_files(tmp_path):
    source = ProtobufTypes()
    assert isinstance(source, TypeSource)
    file = tmp_path / "types.desc"
    file.write_bytes(SET.SerializeToString())
    source.load([file])
    assert source.type_names() == ["new.Edition", "old.Legacy", "old.Legacy.Part", "test.Every", "test.Vector"]
    assert source.type_named("test.Every") is source.type_named("test.Every")
    assert source.type_named(".test.Vector").name == "test.Vector"
    assert source.type_named("test.Nothing") is None


def test_the_schema_holds_all_that_is_needed():
    kind = ProtobufTypes().type_of_schema(EVERY.schema)
    assert kind.leaves(PAYLOAD) == EVERY.leaves(PAYLOAD)
    found = descriptor_pb2.FileDescriptorSet.FromString(EVERY.schema.data)
    assert [each.name for each in found.file] == ["base.proto", "main.proto"]
    assert kind.schema is EVERY.schema


def test_types_of_logs():
    source = ProtobufTypes()
    data = SET.SerializeToString()
    assert source.type_of_schema(Schema("test.Vector", "protobuf", data)).name == "test.Vector"
    for schema in (
        Schema("test.Nothing", "protobuf", data),
        Schema("test.Every", "protobuf", b"\xff\xff"),
        Schema("test.Every", "protobuf", b""),
        Schema("test.Every", "ros2msg", data),
    ):
        assert source.type_of_schema(schema) is None


def test_a_set_that_lacks_a_file():
    kind = ProtobufTypes().type_of_schema(
        Schema("test.Every", "protobuf", SET.file[1].SerializeToString() and _alone())
    )
    found = leaves(PAYLOAD, kind)
    assert found["f_int32"] == 300
    assert "at.x" not in found
    assert kind.rebuild(PAYLOAD, {"f_int32": 3}) == EVERY.rebuild(PAYLOAD, {"f_int32": 3})


def _alone():
    alone = descriptor_pb2.FileDescriptorSet()
    alone.file.append(SET.file[1])
    return alone.SerializeToString()


@pytest.mark.parametrize("data", [b"", b"\xff", b"no descriptor set"])
def test_files_that_are_none(tmp_path, data):
    file = tmp_path / "types.desc"
    file.write_bytes(data)
    with pytest.raises(ConfigError, match="FileDescriptorSet") as caught:
        ProtobufTypes().load([file])
    assert caught.value.where == str(file)
    assert "protoc" in caught.value.hint
    with pytest.raises(ConfigError, match="cannot read"):
        ProtobufTypes().load([tmp_path / "missing.desc"])


def test_without_the_library(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"'\.\[protobuf\]'"):
        ProtobufTypes()


def test_hostile_definitions_are_listed_in_part():
    deep = descriptor_pb2.FileDescriptorSet()
    file = deep.file.add(name="deep.proto", syntax="proto3")
    for number in range(5000):
        message = file.message_type.add(name=f"M{number}")
        field = message.field.add(name="m", number=1, type=11, label=1, type_name=f".M{number + 1}")
        assert field.name
    file.message_type.add(name="M5000").field.add(name="x", number=1, type=1, label=1)
    wide = deep.file.add(name="wide.proto", syntax="proto3")
    for number in range(9):
        message = wide.message_type.add(name=f"W{number}")
        for member in range(20):
            message.field.add(name=f"m{member}", number=member + 1, type=11, label=1, type_name=f".W{number + 1}")
    wide.message_type.add(name="W9")
    source = ProtobufTypes()
    for name in ("M0", "W0"):
        kind = source.type_of_schema(Schema(name, "protobuf", deep.SerializeToString()))
        assert kind.fields() == []
        assert kind.leaves(b"") == []
