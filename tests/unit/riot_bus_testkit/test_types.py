import json

import cbor2
import msgpack
import pytest

from riot_bus.types.cbor_type import CborType
from riot_bus.types.json_type import JsonType
from riot_bus.types.msgpack_type import MsgpackType
from riot_bus.types.raw_type import RawType, StructType
from riot_bus_testkit.types import HostileConformance, TypeConformance

DOCUMENT = {
    "pose": {"x": 1.5, "n": 3, "big": 1 << 40},
    "ranges": [1, 2, -300],
    "points": [{"x": 1.0, "name": "a"}, {"x": -2.5, "name": "bb"}],
    "matrix": [[1.0, 2.0], [3.0]],
    "odd key": "aé",
    "on": True,
    "none": None,
    "empty": [],
}
BINARY = DOCUMENT | {"raw": b"ab", 7: -1, "huge": (1 << 64) - 1}


class TestJson(TypeConformance):
    kind = JsonType()
    payloads = (
        json.dumps(DOCUMENT).encode(),
        json.dumps(DOCUMENT, indent=2, ensure_ascii=False).encode(),
        b'[ 1.50,2 , {"a":[ ]},"\\u00e9"]',
        b"3",
    )


class TestMsgpack(TypeConformance):
    kind = MsgpackType()
    payloads = (
        msgpack.packb(BINARY),
        msgpack.packb({"a": 1.5, "b": [0.5]}, use_single_float=True),
        msgpack.packb([list(range(20)), {"a": b"x" * 40}]),
    )


class TestCbor(TypeConformance):
    kind = CborType()
    payloads = (
        cbor2.dumps(BINARY),
        cbor2.dumps({"half": 1.5, "single": 3.1415927410125732, "double": 0.1}, canonical=True),
        bytes.fromhex(
            "bf61619f01820203ff6162c07830313233343536373839303132333435363738393031323334353637383930313233343536373839303132333435363738ff"
        ),
        bytes.fromhex("9f7f61616162ff5f4101ff1bffffffffffffffff3818ff"),
    )


class TestStruct(TypeConformance):
    kind = StructType("raw(bool on, uint8 a, int16be b, float32[3] gyro, uint64 n, float64be x @40, int32[2] i)")
    payloads = (bytes(56), bytes(range(1, 61)))


class TestRaw(HostileConformance):
    kind = RawType()
    payloads = (b"", b"some bytes")

    def test_it_is_opaque(self):
        assert self.kind.opaque(b"") == "raw bytes have no fields"
        assert self.kind.patch(b"abc", {}) == self.kind.rebuild(b"abc", {}) == b"abc"


class Careless(JsonType):
    """Raises what it should not."""

    def read(self, payload, path):
        return json.loads(payload)[path]


class Clumsy(MsgpackType):
    """Changes its neighbour too."""

    def patch(self, payload, changes):
        patched = super().patch(payload, changes)
        return patched[:-1] + bytes([patched[-1] ^ 1]) if changes else patched


class Endless(JsonType):
    """Never ends."""

    def leaves(self, payload, *, elements=16):
        while True:
            elements += 1


class Greedy(JsonType):
    """Takes memory for what is not there."""

    def opaque(self, payload):
        return str(len(bytearray(1 << 24)))


def conformance(kind, payload):
    return type("Broken", (TypeConformance,), {"kind": kind, "payloads": (payload,)})()


def test_errors_of_other_kinds_are_caught():
    with pytest.raises(KeyError):
        conformance(Careless(), b'{"a": 1}')._exercise(b"{}", "a")


def test_changes_of_neighbours_are_caught():
    with pytest.raises(AssertionError):
        conformance(Clumsy(), msgpack.packb([1, 2, 3])).test_nothing_to_change()


def test_endless_work_is_caught():
    with pytest.raises(AssertionError, match="lines of Python"):
        conformance(Endless(), b"{}")._exercise(b"{}", "a")


def test_memory_that_is_not_needed_is_caught():
    with pytest.raises(AssertionError, match="bytes of memory"):
        conformance(Greedy(), b"{}").test_memory_is_bounded()
