"""Payloads of small logs that have very many fields, or fields with very long paths, in every encoding."""

import json
import struct
from contextlib import nullcontext

import msgpack
import pytest

from riot_bus.types.cbor_type import CborType
from riot_bus.types.json_type import JsonType
from riot_bus.types.listing import describe
from riot_bus.types.model import MOST_LEAVES
from riot_bus.types.msgpack_type import MsgpackType
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2 import cdr, cdr_fields, cdr_rebuild
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.definitions import parse_recorded
from riot_bus_ros2.store import TypeStore

LONG = "n" * 100_000


def cbor(value):
    """Encode lists, maps and small integers."""
    if isinstance(value, list):
        return b"\x98" + bytes([len(value)]) + b"".join(map(cbor, value))
    if isinstance(value, dict):
        items = b"".join(b"\x7a" + struct.pack(">I", len(key)) + key.encode() + cbor(one) for key, one in value.items())
        return b"\xb8" + bytes([len(value)]) + items
    return bytes([value])


DOCUMENTS = [(JsonType, lambda data: json.dumps(data).encode()), (MsgpackType, msgpack.packb), (CborType, cbor)]


def nested(levels, last, *, fields="B{} a\nB{} b\n"):
    """Return the type of messages that have 2 to the power of `levels` of the `last` fields."""
    parts = [fields.format(1, 1)]
    parts += [f"MSG: p/B{n}\n{fields.format(n + 1, n + 1)}" for n in range(1, levels)]
    text = ("=" * 80 + "\n").join([*parts, f"MSG: p/B{levels}\n{last}\n"])
    return CdrType("p/msg/A", TypeStore(parse_recorded(text, "p/msg/A")))


def lists(levels):
    return [lists(levels - 1)] * 16 if levels else 1


@pytest.mark.parametrize(("kind", "encode"), DOCUMENTS)
def test_documents_of_nested_lists(kind, encode):
    assert len(kind().leaves(encode(lists(3)))) == 16**3 + 16**2 + 16 + 1
    payload = encode(lists(5))
    with pytest.raises(PayloadError, match=f"opaque: more than {MOST_LEAVES} fields"):
        kind().leaves(payload)
    assert "more than" in (kind().opaque(payload) or "")
    assert kind().read(payload, "value[3][4][5][6][15]") == 1  # one by one


@pytest.mark.parametrize(("kind", "encode"), DOCUMENTS)
def test_documents_with_a_long_name_around_many_fields(kind, encode):
    payload = encode({LONG: {f"k{n}": 1 for n in range(200)}})
    with pytest.raises(PayloadError, match="path has more than 1024 characters"):
        kind().leaves(payload)


def test_ros_messages_of_nested_types():
    kind = nested(40, "uint8 x")
    payload = b"\0\1\0\0" + bytes(4 * MOST_LEAVES)
    with pytest.raises(PayloadError, match=f"opaque: more than {MOST_LEAVES} fields"):
        kind.leaves(payload)
    assert kind.read(payload, ".".join(["a"] * 40) + ".x") == 0
    few = nested(10, "uint8 x")
    assert len(few.leaves(b"\0\1\0\0" + bytes(1 << 10))) == 1 << 10


def test_more_elements_are_listed_if_more_are_wanted():
    kind = CdrType("p/msg/A", TypeStore(parse_recorded("uint8[] x\nuint8[] y\n", "p/msg/A")))
    count = MOST_LEAVES + 8
    payload = b"\0\1\0\0" + struct.pack("<I", count) + bytes(count) + struct.pack("<I", 0)
    assert len(kind.leaves(payload, elements=1 << 20)) == count + 2


@pytest.mark.parametrize("last", ["", "uint8[0] x"])
def test_nested_messages_without_fields_are_not_visited(monkeypatch, last):
    visits = []
    collect = cdr._collect
    monkeypatch.setattr(cdr, "_collect", lambda *words: visits.append(1) or collect(*words))
    kind = nested(18, last, fields="B{} a\nB{}[3] b\n")
    with pytest.raises(PayloadError, match="are too few") if not last else nullcontext():
        assert list(kind.leaves(b"\0\1\0\0" + bytes(1 << 16))) == []
    assert len(visits) < 10


def test_a_long_name_in_a_definition():
    text = f"B1 {LONG}\n" + "=" * 80 + "\nMSG: p/B1\n" + "".join(f"uint8 a{n}\n" for n in range(200))
    kind = CdrType("p/msg/A", TypeStore(parse_recorded(text, "p/msg/A")))
    assert "path has more than 1024 characters" in describe(kind).problem


def test_parts_are_listed_with_one_look_at_each_definition():
    inner = "".join(f"uint8 a{n}\n" for n in range(50))
    text = "".join(f"B1 b{n}\n" for n in range(500)) + "=" * 80 + f"\nMSG: p/B1\n{inner}"
    store, looks = TypeStore(parse_recorded(text, "p/msg/A")), []
    found = cdr_fields.list_parts("p/msg/A", lambda name: looks.append(name) or store.fields(name))
    assert (len(found), sorted(looks)) == (501, ["p/msg/A", "p/msg/B1"])
    assert (found[500].path, found[500].type_name) == ("b499", "p/msg/B1")


def test_values_of_a_message_with_very_many_fields_and_constants_have_no_names():
    def names(number):
        text = "".join(f"uint8 A{n}_ON=1\nuint8 a{n}\n" for n in range(number))
        return CdrType("p/msg/A", TypeStore(parse_recorded(text, "p/msg/A"))).fields()[0].names

    assert (names(400), names(501)) == (((1, "A0_ON"),), ())


def test_a_new_element_of_nested_texts_stops_at_the_limit_of_a_payload(monkeypatch):
    monkeypatch.setattr("riot_bus.types.model.MOST_BYTES", 1 << 12)
    written = []
    text = cdr_rebuild._Writer.text
    monkeypatch.setattr(cdr_rebuild._Writer, "text", lambda self, data: written.append(1) or text(self, data))
    kind = nested(14, "string x", fields="B{} a\nB{} b\n")
    outer = parse_recorded("A[] a\n" + "=" * 80 + "\nMSG: p/A\n" + kind.schema.data.decode(), "p/msg/Outer")
    with pytest.raises(PayloadError, match="over the limit"):
        CdrType("p/msg/Outer", TypeStore(outer)).rebuild(b"\0\1\0\0" + bytes(4), {"len(a)": 1})
    assert len(written) < 1 << 10


def test_definitions_of_a_log_are_parsed_up_to_a_limit(monkeypatch):
    from riot_bus.types.model import Schema

    monkeypatch.setattr("riot_bus_ros2.adapter._MOST_PARSED", 25)
    adapter = Ros2Adapter()
    one, other = (Schema(f"p/msg/{name}", "ros2msg", b"uint8 some_field\n") for name in "AB")
    for _ in range(3):  # the same definition counts once
        assert adapter.type_of_schema(one).opaque(b"\0\1\0\0\1") is None
    assert (
        adapter.type_of_schema(other).opaque(b"\0\1\0\0\1")
        == "opaque: the definitions in this log have more than 25 bytes"
    )


def test_small_elements_of_protobuf_with_many_fields_that_are_not_on_the_wire():
    descriptor = pytest.importorskip("google.protobuf.descriptor_pb2")
    from riot_bus_protobuf.kind import ProtobufType
    from riot_bus_protobuf.layout import Definitions

    file = descriptor.FileDescriptorProto(name="a.proto", package="p", syntax="proto3")
    inner, outer = file.message_type.add(name="Inner"), file.message_type.add(name="Outer")
    for number in range(1, 2001):
        inner.field.add(name=f"x{number}", number=number, type=13, label=1)
    outer.field.add(name="inner", number=1, type=11, label=3, type_name=".p.Inner")
    kind = ProtobufType("p.Outer", Definitions({file.name: file}))
    assert len(kind.leaves(b"\x0a\0" * 60, elements=100)) == 1 + 60 * 2000
    with pytest.raises(PayloadError, match="opaque: more than"):
        kind.leaves(b"\x0a\0" * 90, elements=100)
