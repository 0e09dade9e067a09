import math

import msgpack
import pytest

from riot_bus.types.model import Leaf, MessageType
from riot_bus.types.msgpack_type import MsgpackType
from riot_bus.vocabulary.errors import PayloadError

MSGPACK = MsgpackType()
DOCUMENT = {"pose": {"x": 1.5, "n": 3}, "ranges": [1, 2.0, True], "odd key": "aé", "none": None, "raw": b"ab", 7: -1}
PACKED = msgpack.packb(DOCUMENT)


def unpack(payload):
    return msgpack.unpackb(payload, strict_map_key=False)


def test_is_a_message_type():
    assert isinstance(MSGPACK, MessageType)
    assert (MSGPACK.name, MSGPACK.encoding, MSGPACK.schema) == ("msgpack", "msgpack", None)


def test_leaves():
    assert MSGPACK.leaves(PACKED) == [
        Leaf("pose.x", "float64", 1.5),
        Leaf("pose.n", "int64", 3),
        Leaf("len(ranges)", "uint32", 3),
        Leaf("ranges[0]", "int64", 1),
        Leaf("ranges[1]", "float64", 2.0),
        Leaf("ranges[2]", "bool", True),
        Leaf('["odd key"]', "string", "aé"),
        Leaf("raw", "bytes", b"ab"),
        Leaf("[7]", "int64", -1),
    ]
    assert all(MSGPACK.read(PACKED, leaf.path) == leaf.value for leaf in MSGPACK.leaves(PACKED))


def test_leaves_of_a_long_array_are_cut():
    found = MSGPACK.leaves(msgpack.packb({"a": list(range(100)), "b": 1}), elements=1)
    assert [leaf.path for leaf in found] == ["len(a)", "a[0]", "b"]


@pytest.mark.parametrize(
    ("old", "new", "packed"),
    [
        (3, 4, b"\x04"),
        (3, -5, b"\xfb"),
        (3, 200, b"\xcc\xc8"),
        (3, -200, b"\xd1\xff\x38"),
        (200, 3, b"\xcc\x03"),
        (200, 70000, b"\xce\x00\x01\x11\x70"),
        (200, -1, b"\xd0\xff"),
        (-100, 100, b"\xd0\x64"),
        (-100, 200, b"\xd1\x00\xc8"),
        (3, (1 << 64) - 1, b"\xcf" + b"\xff" * 8),
        (3, 1 << 64, b"\x00"),
        (3, -(1 << 63) - 1, b"\xcf\x7f" + b"\xff" * 7),
        (-100, (1 << 64) - 1, b"\xcf" + b"\xff" * 8),
        (3, 0.5, b"\xcb\x3f\xe0" + b"\0" * 6),
        (1.5, 2, b"\xcb\x40" + b"\0" * 7),
        pytest.param(1.5, 10**400, b"\xcb\x7f\xf0" + b"\0" * 6, id="overflow"),
        (True, False, b"\xc2"),
        ("ab", "abc", b"\xa3abc"),
        ("ab", "a" * 32, b"\xd9\x20" + b"a" * 32),
        ("a" * 40, "b", b"\xd9\x01b"),
        ("ab", "a" * 300, b"\xda\x01\x2c" + b"a" * 300),
        (b"ab", b"c", b"\xc4\x01c"),
        (b"ab", b"c" * 300, b"\xc5\x01\x2c" + b"c" * 300),
        ("ab", b"c", b"\xc4\x01c"),
    ],
)
def test_patch_keeps_the_format_or_widens_it(old, new, packed):
    before, after = msgpack.packb(["first", 1]), msgpack.packb(None)
    payload = b"\x93" + before + msgpack.packb(old) + after
    assert MSGPACK.patch(payload, {"value[1]": new}) == b"\x93" + before + packed + after


def test_float32_keeps_its_width():
    payload = msgpack.packb({"a": 1.5}, use_single_float=True)
    assert MSGPACK.leaves(payload) == [Leaf("a", "float32", 1.5)]
    assert MSGPACK.patch(payload, {"a": 2.5}) == msgpack.packb({"a": 2.5}, use_single_float=True)
    assert MSGPACK.read(MSGPACK.patch(payload, {"a": -1e300}), "a") == -math.inf


def test_large_unsigned_integers_have_their_own_type():
    assert MSGPACK.leaves(msgpack.packb({"a": 1 << 63})) == [Leaf("a", "uint64", 1 << 63)]


def test_patch_of_several_fields():
    changed = unpack(MSGPACK.patch(PACKED, {"raw": b"xyz", "pose.x": 9.0, "[7]": 5}))
    assert changed == DOCUMENT | {"raw": b"xyz", "pose": {"x": 9.0, "n": 3}, 7: 5}


def test_of_duplicate_keys_the_last_counts():
    payload = b"\x82\xa1a\x01\xa1a\x02"
    assert MSGPACK.leaves(payload) == [Leaf("a", "int64", 2)]
    assert MSGPACK.patch(payload, {"a": 5}) == b"\x82\xa1a\x01\xa1a\x05"


def test_extensions_and_odd_keys_are_no_fields():
    document = {"t": msgpack.Timestamp(1, 2), "e": msgpack.ExtType(3, b"abc"), True: 1, b"k": 2, "x": 1}
    payload = msgpack.packb(document)
    assert [leaf.path for leaf in MSGPACK.leaves(payload)] == ["x"]
    assert MSGPACK.patch(payload, {"x": 2}) == msgpack.packb(document | {"x": 2})
    with pytest.raises(PayloadError, match="ext is not a scalar"):
        MSGPACK.read(payload, "e")


def test_text_that_is_not_utf8_survives():
    payload = b"\x82\xa1a\xa2\xff\xfe\xa1b\x01"
    text = MSGPACK.read(payload, "a")
    assert MSGPACK.patch(payload, {"a": text}) == payload
    with pytest.raises(PayloadError, match="cannot be encoded"):
        MSGPACK.patch(payload, {"a": "\ud800"})


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        b"\x81",
        b"\x81\xa1a",
        b"\xdf\xff\xff\xff\xff",
        b"\xdd\xff\xff\xff\xff\x01",
        b"\xdb\xff\xff\xff\xffabc",
        b"\xc9\xff\xff\xff\xff\x01",
        b"\x81\xa1a\xcb\x00",
        b"\x81\xc1\x01",
    ],
)
def test_hostile_bytes(payload):
    for act in (MSGPACK.leaves, lambda p: MSGPACK.read(p, "a"), lambda p: MSGPACK.patch(p, {"a": 1})):
        with pytest.raises(PayloadError):
            act(payload)


def test_nesting_is_bounded():
    deep = b"\x91" * 100_000 + b"\x01"
    assert MSGPACK.is_container(deep)
    with pytest.raises(PayloadError, match="nested deeper than 64"):
        MSGPACK.leaves(deep)


def test_bytes_after_the_document():
    with pytest.raises(PayloadError, match="follow"):
        MSGPACK.leaves(PACKED + b"\0")


@pytest.mark.parametrize(
    ("payload", "answer"),
    [(PACKED, True), (b"\x93\x01\x02\x03", True), (PACKED + b"\0", False), (b"\x80", False), (b"\x05", False)],
)
def test_is_container(payload, answer):
    assert MSGPACK.is_container(payload) is answer


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("pose.xx", "no field 'xx'"),
        ("pose", "map is not a scalar"),
        ("none", "nil is not a scalar"),
        ("ranges[3]", "no element 3 in an array of 3"),
        ("ranges[-1]", "no element -1"),
        ("ranges.x", "no field 'x'"),
        ("pose.x.y", "no field 'y'"),
    ],
)
def test_paths_that_lead_nowhere(path, message):
    with pytest.raises(PayloadError, match=message):
        MSGPACK.read(PACKED, path)
    with pytest.raises(PayloadError, match=message):
        MSGPACK.patch(PACKED, {path: 1})


def test_lengths():
    assert MSGPACK.read(PACKED, "len(ranges)") == 3
    with pytest.raises(PayloadError, match="only arrays"):
        MSGPACK.read(PACKED, "len(pose)")
    with pytest.raises(PayloadError, match="length cannot be patched"):
        MSGPACK.patch(PACKED, {"len(ranges)": 1})


def test_a_root_that_is_no_map():
    assert MSGPACK.read(msgpack.packb(5), "value") == 5
    with pytest.raises(PayloadError, match="begins with 'value'"):
        MSGPACK.read(msgpack.packb(5), "x")
