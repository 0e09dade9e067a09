"""Types of fields that are learnt from a log: a field that was ever fractional is a float, in any format."""

import json
import math

import pytest

from riot_bus.types.capabilities import OmitsFields
from riot_bus.types.learnt import learn_types
from riot_bus.types.model import MessageType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message

cbor2 = pytest.importorskip("cbor2")
msgpack = pytest.importorskip("msgpack")

WRITERS = {
    "application/json": lambda fields: json.dumps(fields).encode(),
    "application/cbor": cbor2.dumps,
    "application/msgpack": msgpack.dumps,
}


@pytest.fixture(params=WRITERS)
def encoding(request):
    return request.param


def learnt(encoding, *logged):
    """Return what reads a registry's types of a message, after these have been seen, and the writer of payloads."""
    registry, write = TypeRegistry(), WRITERS[encoding]
    learn_types([Message(0, "pose", write(fields), encoding=encoding) for fields in logged], registry)

    def types(fields):
        payload = write(fields)
        kind = registry.type_of("pose", payload=payload, encoding=encoding)
        return {leaf.path: (leaf.type, leaf.value) for leaf in kind.leaves(payload)}

    return types


def test_elements_of_an_array_have_one_type(encoding):
    types = learnt(encoding, {"data": [1.5, 0, 0], "n": [1, 2]})
    found = types({"data": [0, 0], "n": [3]})
    assert found["data[0]"] == found["data[1]"] == ("float64", 0.0)
    assert isinstance(found["data[0]"][1], float)
    assert found["n[0]"] == ("int64", 3)
    assert found["len(data)"] == ("uint32", 2)


def test_a_field_that_was_ever_fractional_is_a_float(encoding):
    types = learnt(encoding, {"x": 0, "n": 0}, {"x": 0.5, "n": 1})
    assert types({"x": 7, "n": 7}) == {"x": ("float64", 7.0), "n": ("int64", 7)}


def test_what_is_no_number_stays_what_it_is(encoding):
    types = learnt(encoding, {"x": 0, "on": True, "name": "a"}, {"x": 0.5, "on": 1, "name": 2})
    assert types({"x": "far", "on": True, "name": "b"}) == {
        "x": ("string", "far"),
        "on": ("bool", True),
        "name": ("string", "b"),
    }


def test_it_is_a_self_describing_type_and_writes_what_its_encoding_can(encoding):
    write, registry = WRITERS[encoding], TypeRegistry()
    learn_types([Message(0, "pose", write({"x": [0, 0.5]}), encoding=encoding)], registry)
    kind = registry.type_of("pose", encoding=encoding)
    assert isinstance(kind, MessageType)
    assert isinstance(kind, OmitsFields)
    payload = write({"x": [0, 0]})
    assert math.isnan(kind.read(kind.patch(payload, {"x[1]": math.nan}), "x[1]"))
    assert isinstance(kind.read(payload, "x[0]"), float)
    assert kind.read(payload, "len(x)") == 2
    assert kind.opaque(payload) is None
    assert kind.opaque(b"\xc1") is not None
    assert kind.leaves(kind.omit(payload, "x")) == []
    assert len(kind.leaves(kind.rebuild(payload, {"len(x)": 5}))) == 6


def test_payloads_that_cannot_be_read_say_nothing(encoding):
    registry, write = TypeRegistry(), WRITERS[encoding]
    payloads = [write({"x": 0}), b"", write({"x": 0.5})[:-1], write({"x": 0.5})]
    learn_types([Message(0, "pose", each, encoding=encoding) for each in payloads], registry)
    assert registry.type_of("pose", encoding=encoding).leaves(write({"x": 0}))[0].type == "float64"
