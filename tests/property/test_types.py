"""Properties that hold for the payloads of every type: patching one field changes that field alone."""

import json
import math
import random
import struct

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from riot_bus.types.json_type import JsonType
from riot_bus.types.msgpack_type import MsgpackType
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.adapter import Ros2Adapter
from tests.tiers import scaled

rosbags = pytest.importorskip("rosbags")
from rosbags.typesys import Stores, get_typestore  # noqa: E402

JSON, MSGPACK, ROS2 = JsonType(), MsgpackType(), Ros2Adapter()
STORE = get_typestore(Stores.ROS2_KILTED)
PACKAGES = ("sensor_msgs", "nav_msgs", "geometry_msgs", "std_msgs")
NAMES = sorted(name for name in STORE.fielddefs if name.startswith(PACKAGES))
INT64 = st.integers(-(1 << 63), (1 << 63) - 1)
SCALARS = st.booleans() | INT64 | st.floats(allow_nan=False) | st.text(max_size=8)


def documents(scalars, keys):
    return st.dictionaries(
        keys,
        st.recursive(
            scalars | st.none(),
            lambda inner: st.lists(inner, max_size=4) | st.dictionaries(keys, inner, max_size=4),
            max_leaves=12,
        ),
        max_size=4,
    )


def alike(one, other):
    return one == other or (one != one and other != other)


def check_patch(kind, payload, data, values):
    fields = [leaf for leaf in kind.leaves(payload, elements=100) if not leaf.path.startswith("len(")]
    assume(fields)
    chosen = data.draw(st.sampled_from(fields))
    value = data.draw(values[chosen.type])
    patched = kind.patch(payload, {chosen.path: value})
    assert alike(kind.read(patched, chosen.path), value)
    before = [leaf for leaf in kind.leaves(payload, elements=100) if leaf.path != chosen.path]
    after = [leaf for leaf in kind.leaves(patched, elements=100) if leaf.path != chosen.path]
    assert before == after
    assert all(alike(kind.read(payload, leaf.path), leaf.value) for leaf in before)
    assert kind.patch(patched, {chosen.path: chosen.value}) is not None
    return chosen, value, patched


def set_in(document, path, value):
    """Set a value in a Python document without our parser of paths."""
    for key in list(document) if isinstance(document, dict) else range(len(document)):
        here = document[key]
        forms = [f"[{key}]"] if isinstance(key, int) else [f"[{json.dumps(key, ensure_ascii=False)}]"]
        forms += [f".{key}", key] if isinstance(key, str) and key.isidentifier() else []
        for form in forms:
            if path == form and not isinstance(here, dict | list):
                document[key] = value
                return True
            rest = path[len(form) :]
            if (
                path.startswith(form)
                and rest[:1] in (".", "[")
                and isinstance(here, dict | list)
                and set_in(here, rest, value)
            ):
                return True
    return False


@settings(deadline=None)
@given(documents(SCALARS, st.text(max_size=4)), st.data(), st.sampled_from([None, 1]), st.booleans())
def test_json_patch(document, data, indent, ascii_only):
    payload = json.dumps(document, indent=indent, ensure_ascii=ascii_only).encode()
    values = {"bool": st.booleans(), "int64": INT64, "float64": st.floats(), "string": st.text()}
    chosen, value, patched = check_patch(JSON, payload, data, values)
    expected = json.loads(payload)
    assert set_in(expected, chosen.path, value)
    assert repr(json.loads(patched)) == repr(expected)


@settings(deadline=None)
@given(documents(SCALARS | st.binary(max_size=5), st.text(max_size=4) | st.integers(0, 300)), st.data())
def test_msgpack_patch(document, data):
    payload = msgpack.packb(document)
    uint64 = st.integers(1 << 63, (1 << 64) - 1)
    values = {
        "bool": st.booleans(),
        "int64": INT64 | uint64,
        "uint64": uint64,
        "float64": st.floats(),
        "string": st.text(),
        "bytes": st.binary(max_size=300),
    }
    chosen, value, patched = check_patch(MSGPACK, payload, data, values)
    expected = msgpack.unpackb(payload, strict_map_key=False)
    assert set_in(expected, chosen.path, value)
    assert repr(msgpack.unpackb(patched, strict_map_key=False)) == repr(expected)


def only_payload_errors(kind, payload, path):
    for act in (
        lambda: kind.leaves(payload),
        lambda: kind.read(payload, path),
        lambda: kind.patch(payload, {path: 1}),
        lambda: kind.patch(payload, {path: "text"}),
    ):
        try:
            act()
        except PayloadError:
            continue


@settings(deadline=None)
@given(st.binary(max_size=60), st.text(max_size=8))
def test_random_bytes_and_paths(payload, path):
    for kind in (JSON, MSGPACK):
        only_payload_errors(kind, payload, path)
        only_payload_errors(kind, payload, "value[0]")


@settings(deadline=None)
@given(st.text(alphabet='{}[]",:0123eE.-+ \\un truefalsn', max_size=30))
def test_random_text_that_resembles_json(text):
    only_payload_errors(JSON, text.encode(), "a")


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from(NAMES), st.binary(max_size=200), st.booleans(), st.data())
def test_random_cdr(name, body, little, data):
    kind = ROS2.type_named(name)
    template = kind.leaves(encode(random_message(random.Random(0), name), name, little=True))
    path = data.draw(st.sampled_from([leaf.path for leaf in template])) if template else "data"
    only_payload_errors(kind, bytes([0, little, 0, 0]) + body, path)
    only_payload_errors(kind, body, path)


def encode(message, name, *, little):
    return bytes(STORE.serialize_cdr(message, name, little_endian=little))


def random_base(rng, name):
    if name == "string":
        return "".join(rng.choices("abé ", k=rng.randrange(7)))
    if name == "bool":
        return rng.random() < 0.5
    if name.startswith("float"):
        value = rng.uniform(-1e6, 1e6)
        return struct.unpack("<f", struct.pack("<f", value))[0] if name == "float32" else value
    bits = {"byte": 7, "char": 8}.get(name) or int(name.lstrip("uint"))
    return rng.getrandbits(bits) - (1 << (bits - 1) if name.startswith("int") else 0)


def random_field(rng, kind, content):
    if kind == 1:
        return random_base(rng, content[0])
    if kind == 2:
        return random_message(rng, content)
    (inner, element), size = content
    values = [random_field(rng, inner, element) for _ in range(size if kind == 3 else rng.randrange(5))]
    if inner == 1 and element[0] != "string":
        dtype = {"bool": "bool", "char": "uint8", "byte": "uint8"}.get(element[0], element[0])
        return np.array(values, dtype=dtype)
    return values


def random_message(rng, name):
    fields = STORE.fielddefs[name][1]
    return STORE.types[name](*(random_field(rng, *description) for _, description in fields))


def flatten(message, name, path=""):
    for field, (kind, content) in STORE.fielddefs[name][1]:
        if field == "structure_needs_at_least_one_member":
            continue
        here = f"{path}.{field}" if path else field
        value = getattr(message, field)
        if kind < 3:
            yield from flatten(value, content, here) if kind == 2 else [(here, plain(value, content[0]))]
            continue
        if kind == 4:
            yield f"len({here})", len(value)
        inner, element = content[0]
        for index, each in enumerate(value):
            place = f"{here}[{index}]"
            yield from flatten(each, element, place) if inner == 2 else [(place, plain(each, element[0]))]


def plain(value, base):
    value = value.item() if isinstance(value, np.generic) else value
    return value & 0xFF if base in ("byte", "char") else value


def other_value(rng, leaf):
    if leaf.type == "string":
        return "".join(rng.choices("xyz", k=len(leaf.value.encode())))
    return leaf.value == 0 if leaf.type == "bool" else random_base(rng, leaf.type)


@pytest.mark.parametrize("name", NAMES)
def test_cdr_agrees_with_rosbags(name):
    kind = ROS2.type_named(name)
    for seed in range(4):
        rng = random.Random(f"{name} {seed}")
        payload = encode(random_message(rng, name), name, little=seed % 2 == 0)
        leaves = kind.leaves(payload, elements=1000)
        assert [(leaf.path, leaf.value) for leaf in leaves] == list(flatten(STORE.deserialize_cdr(payload, name), name))
        for leaf in rng.sample(leaves, min(len(leaves), 8)):
            assert kind.read(payload, leaf.path) == leaf.value
            if leaf.path.startswith("len("):
                continue
            value = other_value(rng, leaf)
            patched = kind.patch(payload, {leaf.path: value})
            changed = [index for index, pair in enumerate(zip(payload, patched, strict=True)) if pair[0] != pair[1]]
            size = 1 if leaf.type == "bool" else len(str(value).encode()) if leaf.type == "string" else 8
            assert not changed or changed[-1] - changed[0] < size
            decoded = dict(flatten(STORE.deserialize_cdr(patched, name), name))
            assert decoded == dict(flatten(STORE.deserialize_cdr(payload, name), name)) | {leaf.path: value}


@pytest.mark.parametrize("name", NAMES)
def test_strings_of_other_lengths_agree_with_rosbags(name):
    kind = ROS2.type_named(name)
    rng = random.Random(name)
    payload = encode(random_message(rng, name), name, little=True)
    for leaf in kind.leaves(payload):
        if leaf.type == "string":
            patched = kind.rebuild(payload, {leaf.path: leaf.value + "+++"})
            before = dict(flatten(STORE.deserialize_cdr(payload, name), name))
            assert dict(flatten(STORE.deserialize_cdr(patched, name), name)) == before | {leaf.path: leaf.value + "+++"}


@pytest.mark.parametrize("name", ["Odometry", "Path", "OccupancyGrid"])
def test_cdr_agrees_with_mcap_ros2(name):
    from mcap.records import Schema
    from mcap_ros2.decoder import DecoderFactory

    name = f"nav_msgs/msg/{name}"
    kind = ROS2.type_named(name)
    decode = DecoderFactory().decoder_for("cdr", Schema(1, kind.schema.data, "ros2msg", name))
    for seed in range(5):
        payload = encode(random_message(random.Random(seed), name), name, little=True)
        decoded = decode(payload)
        for leaf in kind.leaves(payload, elements=1000):
            value = decoded
            for step in leaf.path.removeprefix("len(").removesuffix(")").replace("[", ".").replace("]", "").split("."):
                value = value[int(step)] if step.isdigit() else getattr(value, step)
            assert (len(value) if leaf.path.startswith("len(") else value) == leaf.value


@given(st.sampled_from(NAMES), st.integers(0, 1 << 32), st.data())
@settings(deadline=None, max_examples=scaled(60), suppress_health_check=[HealthCheck.too_slow])
def test_cdr_wraps_and_saturates(name, seed, data):
    kind = ROS2.type_named(name)
    payload = encode(random_message(random.Random(seed), name), name, little=True)
    numbers = [leaf for leaf in kind.leaves(payload) if leaf.type[0] in "uif" and not leaf.path.startswith("len(")]
    assume(numbers)
    leaf = data.draw(st.sampled_from(numbers))
    value = data.draw(st.integers(-(1 << 70), 1 << 70) | st.floats(allow_nan=False, allow_infinity=False))
    patched = kind.patch(payload, {leaf.path: value})
    after = kind.read(patched, leaf.path)
    if leaf.type == "float64":
        assert after == float(value)
    elif leaf.type == "float32":
        assert after == float(np.float32(min(max(value, -3.4e38), 3.4e38))) or math.isinf(after) or abs(value) > 3e38
    else:
        bits = int(leaf.type.lstrip("uint"))
        assert (after - int(value)) % (1 << bits) == 0
    assert len(patched) == len(payload)
