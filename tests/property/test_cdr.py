"""CDR of every type of a distribution against codecs that others wrote: mcap-ros2-support, and rosbags."""

import json
import random

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap_ros2")

from riot_bus.types.model import parse_path
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.store import TypeStore
from tests.ros2_messages import (
    COMMON,
    NAMES,
    STORE,
    decode,
    encode,
    leaves,
    random_base,
    random_document,
    value_at,
    with_value,
)
from tests.rosbags_codec import encoded
from tests.tiers import folded

ROS2 = Ros2Adapter()
EVERYTHING = 10_000

each_type = folded("name", NAMES, by=lambda name: name.partition("/")[0])


def test_these_are_all_types():
    assert len(COMMON) > 120
    assert len(NAMES) > 160


@each_type
def test_every_type_round_trips(name):
    kind = ROS2.type_named(name)
    for seed in range(4):
        document = random_document(name, random.Random(f"{name} {seed}"))
        payload = encode(name, document)
        expected = list(leaves(name, document))
        assert [(leaf.path, leaf.value) for leaf in kind.leaves(payload, elements=EVERYTHING)] == expected
        assert kind.opaque(payload) is None
        again = encoded(STORE.decode(payload, name), name, STORE)
        assert decode(name, again) == document
        big = encoded(STORE.decode(payload, name), name, STORE, little_endian=False)
        assert [(leaf.path, leaf.value) for leaf in kind.leaves(big, elements=EVERYTHING)] == expected


@each_type
def test_a_patch_changes_exactly_the_bytes_of_its_field(name):
    kind, rng = ROS2.type_named(name), random.Random(name)
    document = random_document(name, rng)
    little = encode(name, document)
    big = encoded(STORE.decode(little, name), name, STORE, little_endian=False)
    found = kind.leaves(little, elements=EVERYTHING)
    for leaf in rng.sample(found, min(len(found), 12)):
        if leaf.path.startswith("len("):
            continue
        value = other_value(rng, leaf)
        expected = random_document(name, random.Random(name))
        with_value(expected, parse_path(leaf.path).steps, value)
        size = len(value) if leaf.type == "string" else int(leaf.type.lstrip("uintfloab") or 8) // 8
        places = []
        for payload in (little, big):
            patched = kind.patch(payload, {leaf.path: value})
            assert kind.rebuild(payload, {leaf.path: value}) == patched
            assert kind.read(patched, leaf.path) == value
            changed = [at for at, (old, new) in enumerate(zip(payload, patched, strict=True)) if old != new]
            assert not changed or changed[-1] - changed[0] < size
            places += changed
        assert not places or max(places) - min(places) < size  # the same place in both byte orders
        assert decode(name, kind.patch(little, {leaf.path: value})) == expected


@each_type
@pytest.mark.parametrize("little", [True, False])
def test_rebuilding_agrees_with_the_codec(name, little):
    kind, rng = ROS2.type_named(name), random.Random(f"{name} {little}")
    for _ in range(3):
        document = random_document(name, rng)
        payload = encoded(STORE.decode(encode(name, document), name), name, STORE, little_endian=little)
        resizable = [leaf for leaf in kind.leaves(payload) if leaf.type == "string" or leaf.path.startswith("len(")]
        for leaf in rng.sample(resizable, min(len(resizable), 5)):
            path = parse_path(leaf.path)
            if leaf.type == "string":
                value = random_base("string", rng)
                with_value(document, path.steps, value)
            else:
                value = rng.randrange(6)
                elements = value_at(document, path.steps)
                if value and not elements:
                    value = 0  # new elements of an empty sequence: see the next test
                elements[value:] = [elements[-1] for _ in range(value - len(elements))] if elements else []
                document = json.loads(json.dumps(document))  # new elements share nothing
            payload = kind.rebuild(payload, {leaf.path: value})
            as_little = encoded(STORE.decode(payload, name), name, STORE)
            assert len(as_little) == len(payload)
            assert decode(name, as_little) == document
            if leaf.path.startswith("len("):
                break  # paths beyond may be gone
        trailing = payload + b"rest"
        assert kind.rebuild(trailing, {}) == trailing


@each_type
def test_new_elements_of_empty_sequences_are_zero(name):
    kind = ROS2.type_named(name)
    empty = encode(name, random_document(name, random.Random(name), longest=0))
    for leaf in kind.leaves(empty, elements=1):
        if not leaf.path.startswith("len("):
            continue
        payload = kind.rebuild(empty, {leaf.path: 9})
        before = decode(name, empty)
        found = decode(name, payload)
        steps = parse_path(leaf.path).steps
        elements = value_at(found, steps)
        assert len(elements) == 9
        with_value(before, steps, elements)
        assert found == before
        assert not any(map(truth, elements))


def truth(value):
    if isinstance(value, dict):
        return any(map(truth, value.values()))
    return any(map(truth, value)) if isinstance(value, list) else bool(value)


def other_value(rng, leaf):
    if leaf.type == "string":
        return "".join(rng.choices("xyz", k=len(leaf.value.encode())))
    if leaf.type == "bool":
        return not leaf.value
    if leaf.type in ("int8", "uint8"):
        return leaf.value ^ 1
    return random_base(leaf.type, rng)


MIXED = """
Inner[] inners
string name
bool flag
Inner[2] two
float64 value
wstring wide
uint8 last
================================================================================
MSG: pkg/Inner
uint8 a
string<=5 text
float64[] numbers
int16[3] few
"""
MIXED_STORE = TypeStore(parse_msg(MIXED, "pkg/msg/Mixed"))


@folded("seed", range(60), by=lambda seed: f"{seed // 20 * 20} and more")
def test_what_follows_moves_as_it_is(seed):
    """Text that is no UTF-8, odd booleans, padding that is no zero, opaque parts and trailing bytes survive."""
    rng = random.Random(seed)
    text = MIXED.replace("wstring wide\nuint8 last\n", "")
    known = TypeStore(parse_msg(text, "pkg/msg/Mixed"))
    kind, plain = CdrType("pkg/msg/Mixed", MIXED_STORE), CdrType("pkg/msg/Mixed", known)
    name = "pkg/msg/Mixed"
    message = known.decode(encode(name, random_document(name, rng, store=known), known), name)
    payload = encoded(message, name, known, little_endian=seed % 2 == 0)
    payload += b"opaque and more"
    flag = plain.patch(payload, {"flag": 7})
    size = rng.randrange(0, 40)
    changed = plain.rebuild(flag, {"name": "\udcff" * size})
    assert plain.read(changed, "name") == "\udcff" * size
    assert changed.endswith(b"opaque and more")
    assert b"\xff" * size in changed  # the bytes are there, whatever they mean
    same = {leaf.path: leaf.value for leaf in plain.leaves(flag, elements=EVERYTHING) if leaf.path != "name"}
    assert {leaf.path: leaf.value for leaf in plain.leaves(changed, elements=EVERYTHING) if leaf.path != "name"} == same
    if (len(changed) - len(flag)) % 8 == 0:
        assert kind.rebuild(flag, {"name": "\udcff" * size}) == changed
    else:
        with pytest.raises(PayloadError, match="opaque: wstring"):
            kind.rebuild(flag, {"name": "\udcff" * size})
