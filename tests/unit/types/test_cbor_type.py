import math

import cbor2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.types.cbor_type import CborType
from riot_bus.types.model import Leaf, MessageType, member_path
from riot_bus.vocabulary.errors import PayloadError

CBOR = CborType()
DOCUMENT = {"pose": {"x": 1.5, "n": 3}, "ranges": [1, 2.0, True], "odd key": "aé", "none": None, "raw": b"ab", 7: -1}
PACKED = cbor2.dumps(DOCUMENT)
SCALARS = (
    st.booleans()
    | st.integers(-(1 << 63), (1 << 64) - 1)
    | st.floats(allow_nan=False)
    | st.text(max_size=30)
    | st.binary(max_size=30)
)


def test_is_a_message_type():
    assert isinstance(CBOR, MessageType)
    assert (CBOR.name, CBOR.encoding, CBOR.schema) == ("cbor", "cbor", None)


def test_leaves():
    assert CBOR.leaves(PACKED) == [
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


@settings(deadline=None)
@given(st.dictionaries(st.text(max_size=5), SCALARS, min_size=1, max_size=5), SCALARS, st.data(), st.booleans())
def test_patch_agrees_with_the_library(document, value, data, canonical):
    payload = cbor2.dumps(document, canonical=canonical)
    key = data.draw(st.sampled_from(sorted(document)))
    path = member_path("", key)
    assert CBOR.read(payload, path) == document[key]
    patched = CBOR.patch(payload, {path: value})
    after = cbor2.loads(patched)
    assert after[key] == CBOR.read(patched, path)
    assert {name: after[name] for name in after if name != key} == {
        name: document[name] for name in document if name != key
    }
    if type(value) is type(document[key]) and not isinstance(value, float):
        assert after[key] == value


@settings(deadline=None)
@given(
    st.recursive(
        SCALARS | st.none(),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    )
)
def test_reading_agrees_with_the_library(document):
    payload = cbor2.dumps(document)
    assert CBOR.opaque(payload) is None
    for leaf in CBOR.leaves(payload):
        assert CBOR.read(payload, leaf.path) == leaf.value


@pytest.mark.parametrize(
    ("old", "new", "packed"),
    [
        ("03", 4, "04"),
        ("03", -5, "24"),
        ("03", 200, "18c8"),
        ("18c8", 3, "1803"),
        ("18c8", 70000, "1a00011170"),
        ("1903e8", -1, "390000"),
        ("03", (1 << 64) - 1, "1bffffffffffffffff"),
        ("03", 1 << 64, "00"),
        ("03", 0.5, "fb3fe0000000000000"),
        ("f93e00", 2.5, "f94100"),
        ("f93e00", 1e5, "fa47c35000"),
        ("f93e00", math.inf, "f97c00"),
        ("fa3fc00000", 1e300, "fa7f800000"),
        ("fb3ff8000000000000", 2, "fb4000000000000000"),
        pytest.param("f93e00", -(10**400), "f9fc00", id="overflow"),
        ("f5", False, "f4"),
        ("6161", "é", "62c3a9"),
        ("780161", "bc", "78026263"),
        ("7f6161ff", "b", "6162"),
        ("4161", b"", "40"),
        ("c11a514b67b0", 5, "c11a00000005"),
    ],
)
def test_patch_keeps_the_format_or_widens_it(old, new, packed):
    before, after = cbor2.dumps(["first", 1]), cbor2.dumps(None)
    payload = b"\x83" + before + bytes.fromhex(old) + after
    assert CBOR.patch(payload, {"value[1]": new}) == b"\x83" + before + bytes.fromhex(packed) + after


def test_indefinite_lengths():
    payload = bytes.fromhex("bf 6161 9f 01 9f ff 02 ff 6162 bf 6163 03 ff 6164 7f 6161 6162 ff 6165 5f 41 01 ff ff")
    assert {leaf.path: leaf.value for leaf in CBOR.leaves(payload)} == {
        "len(a)": 3, "a[0]": 1, "len(a[1])": 0, "a[2]": 2, "b.c": 3, "d": "ab", "e": b"\x01",
    }  # fmt: skip
    assert cbor2.loads(CBOR.rebuild(payload, {"len(a)": 5, "d": "text"})) == {
        "a": [1, [], 2, 2, 2], "b": {"c": 3}, "d": "text", "e": b"\x01",
    }  # fmt: skip


@pytest.mark.parametrize("count", [0, 1, 3, 4, 24, 300, 70_000])
def test_lengths(count):
    changed = cbor2.loads(CBOR.rebuild(PACKED, {"len(ranges)": count}))
    assert changed == DOCUMENT | {"ranges": ([1, 2.0, True] + [True] * 70_000)[:count]}


def test_integers_below_64_bits_are_floats():
    payload = bytes.fromhex("3bffffffffffffffff")
    assert CBOR.leaves(payload) == [Leaf("value", "float64", -float(1 << 64))]


def test_tags_and_simple_values_are_kept():
    payload = bytes.fromhex("a4 6161 c1 01 6162 f7 6163 f820 6164 d9d9f7 6178".replace(" ", ""))
    assert {leaf.path: leaf.value for leaf in CBOR.leaves(payload)} == {"a": 1, "d": "x"}
    assert CBOR.patch(payload, {"a": 2}) == payload.replace(b"\xc1\x01", b"\xc1\x02")
    with pytest.raises(PayloadError, match="simple is not a scalar"):
        CBOR.read(payload, "c")


@pytest.mark.parametrize(
    "payload",
    [
        "", "1c", "ff", "a1", "a16161", "bf6161ff", "9f01", "9fc1ff", "7f01ff", "7f7f6161ffff", "7bffffffffffffffff",
        "9bffffffffffffffff01", "bbffffffffffffffff", "f8", "fb00", "0102", "c1", "5b7fffffffffffffff00",
    ],
)  # fmt: skip
def test_opaque_payloads(payload):
    payload = bytes.fromhex(payload)
    assert CBOR.opaque(payload)
    with pytest.raises(PayloadError):
        CBOR.leaves(payload)
    with pytest.raises(PayloadError):
        CBOR.read(payload, "a")


@pytest.mark.parametrize("payload", [b"\x81" * 100_000 + b"\x01", b"\x9f" * 100_000, b"\xc1" * 100_000 + b"\x01"])
def test_nesting_is_bounded(payload):
    assert CBOR.opaque(payload)


def test_text_that_is_not_utf8_survives():
    payload = b"\xa1\x61a\x62\xff\xfe"
    assert CBOR.patch(payload, {"a": CBOR.read(payload, "a")}) == payload
    with pytest.raises(PayloadError, match="cannot be encoded"):
        CBOR.patch(payload, {"a": "\ud800"})
