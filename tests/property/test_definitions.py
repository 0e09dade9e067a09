"""Definitions from strangers: whatever a log's schema says, nothing but the errors that are meant come out."""

import random

import pytest

pytest.importorskip("rosbags")

from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.adapter import Ros2Adapter

ROS2 = Ros2Adapter()
PARTS = ("nav_msgs/msg/Odometry", "visualization_msgs/msg/Marker", "rcl_interfaces/msg/ParameterEvent")
SERVICE = b"uint8[<=4] a\nstring<=9[3] b\n---\nwstring c\nstd_msgs/Header d\n"
IDL = b"""#include "x.idl"
module pkg { module msg {
  module A_Constants { const long X = 3 + 4; const string Y = "a" "b"; };
  typedef double three[3];
  @verbatim (language="comment", text="some")
  struct A { @unit(value="m") double x, y; three z; sequence<string<5>, 7> w; pkg::msg::B other; octet o; };
  struct B { wstring<4> t; sequence<boolean> f; };
}; };
"""
SCHEMAS = [
    *(ROS2.type_named(name).schema for name in PARTS),
    Schema("pkg/srv/Ask_Event", "ros2msg", SERVICE),
    Schema(
        "pkg/action/Go_SendGoal_Request", "ros2msg", b"pkg/Go_Goal goal\n" + b"=" * 80 + b"\nMSG: pkg/Go_Goal\nint8 a\n"
    ),
    Schema("pkg/msg/A", "ros2idl", IDL),
]
TOKENS = [
    *(
        b"string",
        b"wstring<=3",
        b"[99999999999]",
        b"[<=3]",
        b"---\n",
        b"=" * 80 + b"\nMSG: a/B\n",
        b"::",
        b"/",
        b"#",
        b"'",
    ),
    *(
        b"(",
        b")",
        b"<<",
        b"{",
        b"};",
        b"struct",
        b"const",
        b"=1e999",
        b"class",
        b"__init__",
        b"\0",
        b"\xff",
        b"\n",
        b"_",
    ),
    *(
        b"float128",
        b"wchar",
        b"Go_Goal",
        b"A",
        b"-1",
        b"structure_needs_at_least_one_member",
        b"int8 data",
        b"import os",
    ),
]


def damaged(data, rng):
    data = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 6))):
        at, size = rng.randrange(len(data) + 1), rng.randrange(1, 30)
        fate = rng.randrange(4)
        if fate == 0:
            del data[at : at + size]
        elif fate == 1:
            data[at:at] = rng.choice(TOKENS)
        elif fate == 2:
            data[at:at] = data[at : at + size]
        elif at < len(data):
            data[at] = rng.randrange(256)
    return bytes(data)


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda schema: schema.name)
def test_damaged_schemas(schema):
    rng = random.Random(schema.name)
    known = 0
    for _ in range(150):
        changed = Schema(schema.name, schema.encoding, damaged(schema.data, rng))
        kind = ROS2.type_of_schema(changed)
        if kind is None:
            continue
        known += 1
        use(kind, bytes((0, rng.randrange(2), 0, 0)) + rng.randbytes(rng.randrange(200)))
    assert known


def use(kind, payload):
    kind.opaque(payload)
    for act in (
        kind.fields,
        kind.parts,
        lambda: kind.type_hash,
        lambda: kind.leaves(payload),
        lambda: ROS2.store.decode(payload, kind.name),
        lambda: kind._store.decode(payload, kind.name),
        lambda: kind._store.schema(kind.name),
    ):
        try:
            act()
        except (PayloadError, KeyError):
            continue
