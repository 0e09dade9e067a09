import struct

import numpy as np
import pytest

from riot_bus.types.capabilities import DescribesFields
from riot_bus.types.fields import FieldType
from riot_bus.types.model import Leaf, MessageType, TypeSource
from riot_bus.types.payloads import Payloads
from riot_bus.types.raw_type import OpaqueType, RawType, StructType
from riot_bus.vocabulary.errors import ConfigError, PayloadError

NAME = "raw(uint32 seq, float32[3] gyro, int16be temperature @20, bool on)"
KIND = StructType(NAME)
PAYLOAD = struct.pack("<I3f4x", 7, 1.5, 2.5, -3.5) + struct.pack(">h?", -40, True) + b"rest"


def test_raw_is_opaque():
    raw = RawType()
    assert isinstance(raw, MessageType)
    assert isinstance(raw, TypeSource)
    assert raw.opaque(b"anything") == "raw bytes have no fields"
    for act in (
        raw.leaves,
        lambda p: raw.read(p, "a"),
        lambda p: raw.patch(p, {"a": 1}),
        lambda p: raw.rebuild(p, {"a": 1}),
    ):
        with pytest.raises(PayloadError, match="raw bytes have no fields"):
            act(b"anything")
    with pytest.raises(ConfigError, match="not defined in files"):
        raw.load([])


def test_an_opaque_type_says_why():
    assert OpaqueType("x", "y", "because").opaque(b"") == "because"


def test_structures_by_name():
    kind = RawType().type_named(NAME)
    assert isinstance(kind, MessageType)
    assert isinstance(kind, DescribesFields)
    assert (kind.name, kind.encoding) == (NAME, "raw")
    assert RawType().type_named("raw") is None
    assert RawType().type_named("pkg/msg/Name") is None


def test_fields():
    assert KIND.fields() == [
        FieldType("seq", "uint32"), FieldType("gyro[*]", "float32", 3), FieldType("temperature", "int16"),
        FieldType("on", "bool"),
    ]  # fmt: skip
    assert KIND.leaves(PAYLOAD, elements=1) == [
        Leaf("seq", "uint32", 7), Leaf("gyro[0]", "float32", 1.5), Leaf("temperature", "int16", -40),
        Leaf("on", "bool", True),
    ]  # fmt: skip
    assert KIND.read(PAYLOAD, "len(gyro)") == 3


def test_patch():
    patched = KIND.patch(PAYLOAD, {"gyro[2]": 1e300, "temperature": 40_000, "on": 0, "seq": -1})
    assert (
        patched == struct.pack("<I3f4x", (1 << 32) - 1, 1.5, 2.5, np.inf) + struct.pack(">h?", -25_536, False) + b"rest"
    )
    assert KIND.rebuild(PAYLOAD, {}) == PAYLOAD


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seq": "x"}, "is not of type uint32"),
        ({"seq": np.nan}, "is not of type uint32"),
        ({"len(gyro)": 2}, "fixed length"),
        ({"sec": 1}, "no such field"),
    ],
)
def test_what_cannot_be_written(changes, message):
    with pytest.raises(PayloadError, match=message):
        KIND.patch(PAYLOAD, changes)


def test_short_payloads_are_opaque():
    assert "22 bytes are too few" in KIND.opaque(PAYLOAD[:22])
    with pytest.raises(PayloadError, match="too few"):
        KIND.read(PAYLOAD[:22], "seq")


def test_elements():
    many = Payloads(
        PAYLOAD * 2 + b"x", np.array([0, len(PAYLOAD), 2 * len(PAYLOAD)]), np.array([len(PAYLOAD)] * 2 + [1])
    )
    assert [each.tolist() for each in KIND.elements(many, "gyro")] == [[1.5, 2.5, -3.5]] * 2
    with pytest.raises(PayloadError, match="no such array"):
        KIND.elements(many, "seq")


@pytest.mark.parametrize(
    "name",
    [
        "raw()",
        "raw(int x y)",
        "raw(uint7 x)",
        "raw(uint8 x, uint8 x)",
        "raw(uint8[0] x)",
        "raw(float64[999999] x)",
        "raw(uint8 x @)",
    ],
)
def test_layouts_that_are_none(name):
    with pytest.raises(ConfigError):
        StructType(name)


def test_a_near_miss_is_named():
    with pytest.raises(ConfigError, match="float32"):
        StructType("raw(float23 x)")
