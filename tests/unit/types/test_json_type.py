import json
import math

import pytest

from riot_bus.types.json_type import JsonType
from riot_bus.types.model import Leaf, MessageType
from riot_bus.vocabulary.errors import PayloadError

JSON = JsonType()
ODD = b'{ "pose" : {"x": 1.50, "n":3},\n "ranges":[1, 2.0 ,true],"odd key":"a\\u00e9", "none":null, "o":{}}'


def leaves(payload, **options):
    return {leaf.path: (leaf.type, leaf.value) for leaf in JSON.leaves(payload, **options)}


def test_is_a_message_type():
    assert isinstance(JSON, MessageType)
    assert (JSON.name, JSON.encoding, JSON.schema) == ("json", "json", None)


def test_leaves_have_types_and_null_is_none():
    assert JSON.leaves(ODD) == [
        Leaf("pose.x", "float64", 1.5),
        Leaf("pose.n", "int64", 3),
        Leaf("len(ranges)", "uint32", 3),
        Leaf("ranges[0]", "int64", 1),
        Leaf("ranges[1]", "float64", 2.0),
        Leaf("ranges[2]", "bool", True),
        Leaf('["odd key"]', "string", "aé"),
    ]


def test_leaves_of_a_long_array_are_cut():
    found = leaves(json.dumps({"a": list(range(100))}).encode(), elements=2)
    assert list(found) == ["len(a)", "a[0]", "a[1]"]
    assert found["len(a)"] == ("uint32", 100)


@pytest.mark.parametrize(
    ("path", "value"),
    [("pose.x", 1.5), ("ranges[2]", True), ("len(ranges)", 3), ('["odd key"]', "aé"), ('["pose"].n', 3)],
)
def test_read(path, value):
    assert JSON.read(ODD, path) == value
    assert type(JSON.read(ODD, path)) is type(value)


@pytest.mark.parametrize(
    ("path", "value", "old", "new"),
    [
        ("pose.x", 2.5, b"1.50", b"2.5"),
        ("pose.x", 2, b"1.50", b"2.0"),
        ("pose.n", 4, b":3", b":4"),
        ("pose.n", 0.5, b":3", b":0.5"),
        ("pose.n", 1 << 63, b":3", b":-9223372036854775808"),
        pytest.param("pose.x", 10**400, b"1.50", b"Infinity", id="overflow"),
        ("ranges[1]", math.nan, b"2.0", b"NaN"),
        ("ranges[1]", -math.inf, b"2.0", b"-Infinity"),
        ("ranges[2]", False, b"true", b"false"),
        ('["odd key"]', 'q"\ud800', b'"a\\u00e9"', b'"q\\"\\ud800"'),
    ],
)
def test_patch_changes_only_the_token(path, value, old, new):
    assert JSON.patch(ODD, {path: value}) == ODD.replace(old, new)


def test_patch_of_several_fields():
    assert JSON.patch(b'{"a":1,"b":[2,3]}', {"b[1]": 33, "a": 11}) == b'{"a":11,"b":[2,33]}'


def test_patch_of_nothing_keeps_the_bytes():
    assert JSON.patch(ODD, {}) == ODD


def test_text_that_is_not_ascii_stays():
    payload = '{"é":"日本","x":1}'.encode()
    assert JSON.patch(payload, {"x": 2}) == '{"é":"日本","x":2}'.encode()


def test_of_duplicate_keys_the_last_counts():
    payload = b'{"a":{"x":1},"b":1,"a":{"x":2},"b":3}'
    assert leaves(payload) == {"a.x": ("int64", 2), "b": ("int64", 3)}
    assert JSON.patch(payload, {"a.x": 7, "b": 8}) == b'{"a":{"x":1},"b":1,"a":{"x":7},"b":8}'


def test_fields_of_an_overridden_duplicate_do_not_exist():
    with pytest.raises(PayloadError, match="no field 'x'"):
        JSON.patch(b'{"a":{"x":1},"a":{"y":2}}', {"a.x": 1})


@pytest.mark.parametrize(("payload", "path"), [(b" 3.5\n", "value"), (b"[[1],3.5]", "value[1]")])
def test_a_payload_that_is_no_object_is_called_value(payload, path):
    assert JSON.read(payload, path) == 3.5
    assert path in leaves(payload)
    assert JSON.patch(payload, {path: 4.5}) == payload.replace(b"3.5", b"4.5")


def test_an_integer_beyond_64_bits_is_a_float():
    assert leaves(b'{"a":18446744073709551616}') == {"a": ("float64", 2.0**64)}


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xff\xfe",
        b"{",
        b'{"a":1}x',
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b"9" * 5000,
        b'"\xed\xa0\x80"',
        "{}".encode("utf-16"),
        b'{"a":"\x01"}',
    ],
)
def test_hostile_bytes(payload):
    for act in (JSON.leaves, lambda p: JSON.read(p, "a"), lambda p: JSON.patch(p, {"a": 1})):
        with pytest.raises(PayloadError):
            act(payload)


def test_nesting_is_bounded():
    deep = b'{"a":' * 70 + b"1" + b"}" * 70
    with pytest.raises(PayloadError, match="nested deeper than 64"):
        JSON.leaves(deep)


def test_size_is_bounded():
    with pytest.raises(PayloadError, match="over the limit"):
        JSON.leaves(b" " * ((1 << 24) + 1))


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("pose.xx", "no field 'xx'"),
        ("pose", "an object is not a scalar"),
        ("ranges", "an array is not a scalar"),
        ("none", "null is not a scalar"),
        ("ranges[3]", "no element 3 in an array of 3"),
        ("ranges[-1]", "no element -1"),
        ("pose[0]", "no field 0"),
        ("ranges.x", "no field 'x'"),
        ("ranges[*]", "is not a field path"),
        ("", "names no field"),
        ('["\\q"]', "is not a quoted key"),
    ],
)
def test_paths_that_lead_nowhere(path, message):
    with pytest.raises(PayloadError, match=message):
        JSON.read(ODD, path)
    with pytest.raises(PayloadError, match=message):
        JSON.patch(ODD, {path: 1})


def test_a_wrong_name_gets_a_suggestion():
    with pytest.raises(PayloadError) as caught:
        JSON.read(b'{"position":1}', "positon")
    assert "did you mean 'position'?" in str(caught.value)


def test_lengths_are_read_only_and_of_arrays():
    with pytest.raises(PayloadError, match="length cannot be patched"):
        JSON.patch(ODD, {"len(ranges)": 1})
    with pytest.raises(PayloadError, match="only arrays"):
        JSON.read(ODD, "len(pose)")


def test_bytes_do_not_fit():
    with pytest.raises(PayloadError, match="no bytes"):
        JSON.patch(ODD, {"pose.n": b"x"})
