"""Many CDR payloads at once give the values that `read` gives for each: any type, byte order, damage."""

import math
import random
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

pytest.importorskip("rosbags")
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from riot_bus.types.bulk import gather
from riot_bus.types.fields import of_numbers
from riot_bus.types.payloads import Payloads
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.store import TypeStore

ROS2 = Ros2Adapter()
STORE = get_typestore(Stores.ROS2_KILTED)
PACKAGES = ("sensor_msgs", "nav_msgs", "geometry_msgs", "std_msgs", "diagnostic_msgs", "tf2_msgs", "trajectory_msgs")
NAMES = sorted(name for name in STORE.fielddefs if name.startswith(PACKAGES))
MIXED = "pkg/msg/Mixed"
MIXED_TEXT = """
string name
bool[] flags
Inner[] inners
string[2] pair
float32 value
Inner[3] three
int64 last
================================================================================
MSG: pkg/Inner
uint8 a
string text
float64[] numbers
"""


def random_base(rng, name):
    if name == "string":
        return "".join(rng.choices("abé ", k=rng.randrange(7)))
    if name == "bool":
        return rng.random() < 0.5
    if name.startswith("float"):
        return rng.choice([rng.uniform(-1e6, 1e6), math.nan, math.inf, -0.0])
    bits = {"byte": 7, "char": 8}.get(name) or int(name.lstrip("uint"))
    return rng.getrandbits(bits) - (1 << (bits - 1) if name.startswith("int") else 0)


def random_field(rng, store, kind, content):
    if kind == 1:
        return random_base(rng, content[0])
    if kind == 2:
        return random_message(rng, store, content)
    (inner, element), size = content
    values = [random_field(rng, store, inner, element) for _ in range(size if kind == 3 else rng.randrange(5))]
    if inner == 1 and element[0] != "string":
        return np.array(values, dtype={"char": "uint8", "byte": "uint8"}.get(element[0], element[0]))
    return values


def random_message(rng, store, name):
    return store.types[name](*(random_field(rng, store, *each) for _, each in store.fielddefs[name][1]))


def payloads_of(bodies):
    buffer, offsets = bytearray(b"before"), []
    for body in bodies:
        offsets.append(len(buffer))
        buffer += body
    lengths = [len(body) for body in bodies]
    return Payloads(bytes(buffer), np.array(offsets, np.int64), np.array(lengths, np.int64))


def mixed():
    store = get_typestore(Stores.ROS2_KILTED)
    store.register(get_types_from_msg(MIXED_TEXT, MIXED))
    return store, CdrType(MIXED, TypeStore(get_types_from_msg(MIXED_TEXT, MIXED)))


MIXED_STORE, MIXED_KIND = mixed()


def bodies_of(store, name, rng, count):
    """Payloads of both byte orders; some are cut off, damaged or of another encapsulation."""
    bodies = []
    for _ in range(count):
        message = random_message(rng, store, name)
        body = bytearray(store.serialize_cdr(message, name, little_endian=rng.random() < 0.6))
        fate = rng.random()
        if fate < 0.15:
            del body[rng.randrange(len(body) + 1) :]
        elif fate < 0.3 and len(body) > 4:
            at = rng.randrange(4, len(body))
            body[at] = rng.randrange(256)
        elif fate < 0.33:
            body[:2] = b"\x00\x03"
        elif fate < 0.36 and len(body) >= 8:
            at = 4 * rng.randrange(1, len(body) // 4)
            body[at : at + 4] = struct.pack("<I", rng.choice([0, 1, 1 << 31, (1 << 32) - 1, 1 << 20]))
        bodies.append(bytes(body))
    return bodies


def check(kind, bodies, path):
    """Values in bulk are those of `read`."""
    try:
        found = gather(kind, payloads_of(bodies), path)
    except PayloadError:
        for body in bodies:
            with pytest.raises(PayloadError):
                kind.read(body, path)
        return
    for body, value, valid in zip(bodies, found.values.tolist(), found.valid.tolist(), strict=True):
        try:
            expected = kind.read(body, path)
        except PayloadError:
            assert not valid
        else:
            assert valid
            assert type(value) is type(expected)
            assert value == expected or (value != value and expected != expected)


def paths_of(kind):
    found = []
    for field in kind.fields():
        found += [field.path.replace("[*]", f"[{index}]") for index in (0, 1, 3)] if "[*]" in field.path else []
        if "[*]" not in field.path:
            found.append(field.path)
    return found


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(st.sampled_from([*NAMES, MIXED]), st.integers(0, 1 << 32), st.integers(0, 60))
def test_bulk_is_what_read_says(name, seed, count):
    rng = random.Random(seed)
    store, kind = (MIXED_STORE, MIXED_KIND) if name == MIXED else (STORE, ROS2.type_named(name))
    bodies = bodies_of(store, name, rng, count)
    paths = paths_of(kind)
    for path in rng.sample(paths, min(len(paths), 6)):
        check(kind, bodies, path)


@given(st.lists(st.binary(max_size=40), max_size=40), st.integers(0, 1 << 32))
def test_random_bytes(bodies, seed):
    rng = random.Random(seed)
    kind = ROS2.type_named(rng.choice(NAMES))
    bodies = [bytes([0, rng.randrange(2), 0, 0]) + body if rng.random() < 0.8 else body for body in bodies]
    for path in rng.sample(paths_of(kind), 1) if kind.fields() else ():
        check(kind, bodies, path)


@pytest.mark.parametrize("name", NAMES)
def test_every_field_of_common_types(name):
    rng = random.Random(name)
    kind = ROS2.type_named(name)
    bodies = bodies_of(STORE, name, rng, 40)
    for path in paths_of(kind):
        check(kind, bodies, path)


@pytest.mark.parametrize("name", [*NAMES, MIXED])
def test_fields_are_those_of_payloads(name):
    store, kind = (MIXED_STORE, MIXED_KIND) if name == MIXED else (STORE, ROS2.type_named(name))
    listed = {field.path: field.type for field in kind.fields()}
    rng = random.Random(name)
    for _ in range(3):
        payload = bytes(store.serialize_cdr(random_message(rng, store, name), name))
        for leaf in kind.leaves(payload, elements=2):
            path = leaf.path.replace("[0]", "[*]").replace("[1]", "[*]")
            assert listed[path] == leaf.type


@pytest.mark.parametrize("count", [1, 5, 200])
@pytest.mark.parametrize("name", ["sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Image", MIXED])
def test_elements_are_those_of_payloads(name, count):
    store, kind = (MIXED_STORE, MIXED_KIND) if name == MIXED else (STORE, ROS2.type_named(name))
    rng = random.Random(f"{name} {count}")
    for field in filter(of_numbers, kind.fields()):
        path = field.path.removesuffix("[*]")
        bodies = bodies_of(store, name, rng, count)
        expected = []
        for body in bodies:
            try:
                length = kind.read(body, f"len({path})")
                expected += [kind.read(body, f"{path}[{index}]") for index in range(length)]
            except PayloadError:
                continue
        found = [value for some in kind.elements(payloads_of(bodies), path) for value in some.tolist()]
        if field.type == "bool":
            found = [bool(value) for value in found]
        assert sorted(map(repr, found)) == sorted(map(repr, expected))


def test_long_arrays_are_yielded_one_by_one():
    kind = ROS2.type_named("std_msgs/msg/Float32MultiArray")
    name, layout = kind.name, STORE.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    values = np.arange(1000, dtype=np.float32)
    body = bytes(STORE.serialize_cdr(STORE.types[name](layout, values), name))
    found = list(kind.elements(payloads_of([body] * 3), "data"))
    assert [some.tolist() for some in found] == [values.tolist()] * 3


def test_absent_elements_are_not_read_one_by_one(monkeypatch):
    kind = ROS2.type_named("sensor_msgs/msg/LaserScan")
    rng = random.Random(3)
    bodies = [
        bytes(STORE.serialize_cdr(random_message(rng, STORE, kind.name), kind.name, little_endian=bool(n % 2)))
        for n in range(50)
    ]
    monkeypatch.setattr(CdrType, "read", lambda *_: pytest.fail("was read on its own"))
    found = gather(kind, payloads_of(bodies), "ranges[3]")
    assert 0 < found.valid.sum() < 50


def test_fields_that_no_payload_has_are_refused():
    kind = ROS2.type_named("nav_msgs/msg/Odometry")
    for path in ("twist.twist.linear.w", "pose", "pose.covariance[36]", "len(header)", "pose.covariance", "x["):
        with pytest.raises(PayloadError):
            gather(kind, payloads_of([]), path)


def test_types_that_nest_without_end_are_listed_at_once():
    empty = "\n".join(f"Empty a{n}" for n in range(10))
    parts = [empty.replace("Empty", "L1")]
    for level in range(1, 40):
        inner = f"L{level + 1}" if level < 39 else "Empty"
        lines = "\n".join(f"{inner} a{n}" for n in range(10))
        parts.append(f"{'=' * 80}\nMSG: pkg/L{level}\n{lines}")
    parts.append(f"{'=' * 80}\nMSG: pkg/Empty\n")
    definitions = get_types_from_msg("\n".join(parts) + "\n", "pkg/msg/L0")
    kind = CdrType("pkg/msg/L0", TypeStore(definitions))
    assert kind.fields() == []
    with pytest.raises(PayloadError):
        kind.leaves(b"\0\1\0\0" + bytes(100))


def test_types_that_nest_without_end_are_passed_at_once():
    line = "=" * 80
    text = "".join(f"T{i} a\nT{i} b\nstring[3] s\n{line}\nMSG: pkg/T{i}\n" for i in range(40)) + "uint8 z\n"
    kind = CdrType("pkg/msg/L0", TypeStore(get_types_from_msg(text, "pkg/msg/L0")))
    bodies = [b"\0\1\0\0" + bytes(200)] * 3
    path = f"b.{'a.' * 39}z"
    found = gather(kind, payloads_of(bodies), path)
    assert not found.valid.any()
    with pytest.raises(PayloadError):
        kind.read(bodies[0], path)


def test_opaque_parts_are_left_to_read():
    text = f"Inner[] inner\nint8 last\n{'=' * 80}\nMSG: pkg/Inner\nwstring text\n"
    kind = CdrType("pkg/msg/L0", TypeStore(parse_msg(text, "pkg/msg/L0")))
    bodies = [b"\0\1\0\0\0\0\0\0\5", b"\0\1\0\0\1\0\0\0\1\0\0\0a\0\0\0\5"]
    found = gather(kind, payloads_of(bodies), "last")
    assert found.valid.tolist() == [True, False]
    assert found.values[0] == 5
    with pytest.raises(PayloadError):
        list(kind.elements(payloads_of(bodies), "inner"))
