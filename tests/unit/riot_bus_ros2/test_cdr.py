import math
import re
import struct
import sys

import pytest

from riot_bus.types.model import REBUILD, Leaf, MessageType
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2 import cdr
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.store import TypeStore
from tests.robot_bag import robot_bag

ODOMETRY = CdrType("nav_msgs/msg/Odometry", TypeStore())


def define(text, name="my_pkg/msg/Test"):
    return CdrType(name, TypeStore(parse_msg(text, name)))


def pack(form, *values):
    """Pack with explicit padding; the encapsulation follows the byte order."""
    return (b"\0\1\0\0" if form[0] == "<" else b"\0\0\0\0") + struct.pack(form, *values)


def odometry(frame=b"odom\0", child=b"base_link\0"):
    data = struct.pack("<iI", 1, 2)
    for text in (frame, child):
        data += b"\xaa" * (-len(data) % 4) + struct.pack("<I", len(text)) + text
    data += b"\xaa" * (-len(data) % 8)
    return b"\0\1\0\0" + data + struct.pack("<85d", *range(85))


MIXED = "bool a\nfloat64 b\nint16 c\nuint8[3] d\nint64[] e\nstring s\nfloat32 f\n"


@pytest.fixture
def mixed():
    return define(MIXED)


def mixed_payload(order="<", count=2, text=b"hi\0"):
    body = struct.pack(order + "?7xdh3B3xI", True, 1.5, -2, 7, 8, 9, count)
    body += b"\0" * (-len(body) % 8 if count else 0) + struct.pack(f"{order}{count}q", *range(10, 10 + count))
    body += b"\0" * (-len(body) % 4) + struct.pack(order + "I", len(text)) + text
    body += b"\0" * (-len(body) % 4) + struct.pack(order + "f", 0.25)
    return (b"\0\1\0\0" if order == "<" else b"\0\0\0\0") + body


def test_is_a_message_type():
    assert isinstance(ODOMETRY, MessageType)
    assert (ODOMETRY.name, ODOMETRY.encoding) == ("nav_msgs/msg/Odometry", "cdr")
    assert b"MSG: geometry_msgs/Pose" in ODOMETRY.schema.data


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("text", [b"\0", b"hi\0", b"hello\0"])
def test_leaves_in_both_byte_orders(mixed, order, count, text):
    payload = mixed_payload(order, count, text)
    expected = [
        Leaf("a", "bool", True),
        Leaf("b", "float64", 1.5),
        Leaf("c", "int16", -2),
        *(Leaf(f"d[{index}]", "uint8", 7 + index) for index in range(3)),
        Leaf("len(e)", "uint32", count),
        *(Leaf(f"e[{index}]", "int64", 10 + index) for index in range(count)),
        Leaf("s", "string", text[:-1].decode()),
        Leaf("f", "float32", 0.25),
    ]
    assert mixed.leaves(payload) == expected
    assert [mixed.read(payload, leaf.path) for leaf in expected] == [leaf.value for leaf in expected]
    assert mixed.read(payload, "len(d)") == 3


def test_leaves_of_long_arrays_are_cut(mixed):
    paths = [leaf.path for leaf in mixed.leaves(mixed_payload(count=2), elements=1)]
    assert paths == ["a", "b", "c", "d[0]", "len(e)", "e[0]", "s", "f"]


@pytest.mark.parametrize("frame", [b"\0", b"a\0", b"ab\0", b"abc\0", b"abcd\0", b"abcdefgh\0"])
def test_offsets_behind_strings(frame):
    payload = odometry(frame, frame[::-1][1:] + b"\0")
    assert ODOMETRY.read(payload, "pose.pose.position.x") == 0.0
    assert ODOMETRY.read(payload, "twist.covariance[35]") == 84.0
    patched = ODOMETRY.patch(payload, {"twist.twist.linear.x": -1.0})
    assert patched == payload.replace(struct.pack("<d", 43.0), struct.pack("<d", -1.0))


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("a", False, False),
        ("b", math.inf, math.inf),
        ("b", 3, 3.0),
        ("c", 1 << 15, -(1 << 15)),
        ("c", -(1 << 15) - 1, (1 << 15) - 1),
        ("c", 2.9, 2),
        ("d[1]", 256 + 5, 5),
        ("d[1]", -1, 255),
        ("e[1]", 1 << 63, -(1 << 63)),
        ("f", 1e300, math.inf),
        ("f", -1e300, -math.inf),
        pytest.param("f", -(10**400), -math.inf, id="huge"),
        ("s", "yo", "yo"),
    ],
)
@pytest.mark.parametrize("order", ["<", ">"])
def test_patch(mixed, order, path, value, expected):
    payload = mixed_payload(order)
    patched = mixed.patch(payload, {path: value})
    assert mixed.read(patched, path) == expected
    others = [leaf for leaf in mixed.leaves(payload) if leaf.path != path]
    assert [leaf for leaf in mixed.leaves(patched) if leaf.path != path] == others
    assert len(patched) == len(payload)


def test_nan_and_odd_booleans(mixed):
    payload = mixed_payload()
    assert math.isnan(mixed.read(mixed.patch(payload, {"f": math.nan}), "f"))
    assert mixed.patch(payload, {"a": 7})[4] == 7
    assert mixed.read(mixed.patch(payload, {"a": 7}), "a") is True


def test_padding_and_trailing_bytes_stay():
    payload = odometry(b"odo\0", b"b\0") + b"garbage"
    patched = ODOMETRY.patch(payload, {"header.frame_id": "map", "header.stamp.sec": -1})
    assert patched == b"\0\1\0\0\xff\xff\xff\xff" + payload[8:].replace(b"odo\0", b"map\0")


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("text", ["", "a", "hello", "hello world", "éa"])
def test_a_string_of_another_length_realigns_the_rest(mixed, order, text):
    changes = {"s": text, "f": 9.5, "e[0]": -4}
    with pytest.raises(PayloadError) as caught:
        mixed.patch(mixed_payload(order), changes)
    assert caught.value.hint == REBUILD
    patched = mixed.rebuild(mixed_payload(order), changes)
    assert mixed.read(patched, "s") == text
    assert mixed.read(patched, "f") == 9.5
    assert mixed.read(patched, "e[0]") == -4
    assert mixed.read(patched, "e[1]") == 11
    assert patched[:4] == mixed_payload(order)[:4]


def test_strings_in_sequences_of_messages():
    text = "Inner[] inner\nuint8 last\n" + "=" * 80 + "\nMSG: my_pkg/Inner\nstring[2] names\nfloat64 x\nint8 class\n"
    kind = define(text)
    element = b"\x02\0\0\0a\0" + b"\0\0" + b"\x02\0\0\0b\0" + b"\0\0"
    payload = b"\0\1\0\0" + b"\x01\0\0\0" + element + b"\0\0\0\0" + struct.pack("<db", 1.5, 3) + b"\x09"
    assert [(leaf.path, leaf.value) for leaf in kind.leaves(payload)] == [
        ("len(inner)", 1),
        ("inner[0].names[0]", "a"),
        ("inner[0].names[1]", "b"),
        ("inner[0].x", 1.5),
        ("inner[0].class", 3),
        ("last", 9),
    ]
    patched = kind.rebuild(payload, {"inner[0].names[1]": "longer", "inner[0].class": -1})
    assert [leaf.value for leaf in kind.leaves(patched)] == [1, "a", "longer", 1.5, -1, 9]


@pytest.mark.parametrize(
    "inner", ["uint8 a", "float32 a\nuint8 b", "uint8 a\nfloat64 b\nfloat32 c", "uint8 a\nuint8 b\nuint16 c\nuint8 d"]
)
@pytest.mark.parametrize("before", ["", "uint8 p\n", "float32 p\n"])
def test_strides_of_arrays_of_messages(inner, before):
    kind = define(f"{before}Inner[] inner\nuint8 last\n" + "=" * 80 + f"\nMSG: my_pkg/Inner\n{inner}\n")
    payload = bytearray(400)
    payload[1] = 1
    leading = {"": 4, "uint8 p\n": 8, "float32 p\n": 8}[before]
    payload[leading] = 12
    last = kind.leaves(bytes(payload), elements=100)[-2].path
    patched = kind.patch(bytes(payload), {"last": 1, last: 2})
    everything = kind.leaves(patched, elements=100)
    assert [leaf.value for leaf in everything if leaf.value not in (0, 12)] == [2, 1]
    assert [kind.read(patched, leaf.path) for leaf in everything] == [leaf.value for leaf in everything]
    assert kind.leaves(patched, elements=0)[-1].value == 1


def test_large_arrays_are_crossed_in_one_step():
    kind = CdrType("sensor_msgs/msg/PointCloud2", TypeStore())
    payload = b"\0\1\0\0" + struct.pack("<iII", 1, 2, 1) + b"\0\0\0\0" + struct.pack("<III", 1, 4096, 0)
    payload += struct.pack("<B3xIII", 0, 16, 65536, 65536) + bytes(65535) + b"\x05" + b"\x01"

    def use():
        assert kind.read(payload, "is_dense") is True
        assert kind.read(payload, "data[65535]") == 5
        assert len(kind.patch(payload, {"is_dense": False})) == len(payload)

    use()  # plans are made once
    calls = []
    former = sys.getprofile()
    sys.setprofile(lambda frame, event, _: calls.append(frame.f_code.co_name) if event == "call" else None)
    try:
        use()
    finally:
        sys.setprofile(former)
    assert len(calls) < 30, calls


def test_plans_are_bounded(monkeypatch, mixed):
    monkeypatch.setattr(cdr, "_CACHED_PLANS", 10)
    payload = mixed_payload(count=50)
    assert [mixed.read(payload, f"e[{index}]") for index in range(50)] == list(range(10, 60))
    assert len(mixed._plans) <= 10


def test_an_empty_message_has_no_fields():
    assert CdrType("std_msgs/msg/Empty", TypeStore()).leaves(b"\0\1\0\0\0") == []
    assert define("\n").leaves(b"\0\1\0\0\0") == []


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("pose.pose.positon.x", "no field 'positon'"),
        ("pose", "a message is not a scalar"),
        ("pose.covariance", "this field is an array"),
        ("len(pose)", "this field is no array"),
        ("pose.covariance[36]", "no element 36 in an array of 36"),
        ("pose.covariance[-1]", "no element -1"),
        ("pose.covariance.x", "no field 'x' here"),
        ("pose[0]", "no field 0 here"),
        ("pose.covariance[*]", "is not a field path"),
    ],
)
def test_paths_that_lead_nowhere(path, message):
    with pytest.raises(PayloadError, match=message) as caught:
        ODOMETRY.read(odometry(), path)
    assert caught.value.where == f"nav_msgs/msg/Odometry: {path}"
    with pytest.raises(PayloadError, match=message):
        ODOMETRY.patch(odometry(), {path: 1})


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("c", "text", "is not of type int16"),
        ("c", math.nan, "nan is not of type int16"),
        ("b", b"x", "is not of type float64"),
        ("s", 5, "is not a string"),
        ("s", "\ud800", "cannot be encoded"),
        ("len(e)", 5, "length cannot be patched"),
        ("e[2]", 5, "no element 2 in a sequence of 2"),
    ],
)
def test_values_that_do_not_fit(mixed, path, value, message):
    with pytest.raises(PayloadError, match=message) as caught:
        mixed.patch(mixed_payload(), {path: value})
    assert path in caught.value.where


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\0",
        b"\0\1",
        b"\0\1\0\0",
        mixed_payload()[:-1],
        mixed_payload()[:30],
        mixed_payload().replace(b"\x02\0\0\0", b"\xff\xff\xff\xff"),
    ],
)
def test_hostile_bytes(mixed, payload):
    for act in (mixed.leaves, lambda p: mixed.read(p, "f"), lambda p: mixed.rebuild(p, {"s": "longer text"})):
        with pytest.raises(PayloadError):
            act(payload)


def test_a_string_without_its_end(mixed):
    payload = mixed_payload().replace(b"hi\0", b"hi!")
    for act in (mixed.leaves, lambda p: mixed.read(p, "s"), lambda p: mixed.rebuild(p, {"s": "hello"})):
        with pytest.raises(PayloadError, match="not terminated"):
            act(payload)


def test_hostile_definitions():
    huge = define("uint8[99999999999999999999] a\nfloat32 b\nstring c\n")
    for path in ("b", "c"):
        with pytest.raises(PayloadError, match="too few"):
            huge.read(mixed_payload(), path)
        with pytest.raises(PayloadError, match="too few"):
            huge.patch(mixed_payload(), {path: 1e300})
    with pytest.raises(PayloadError, match="too few"):
        huge.leaves(mixed_payload())
    separator = "\n" + "=" * 80 + "\nMSG: my_pkg/T"
    for last in ("uint8 z", "uint8[0] z"):
        wide = define("".join(f"T{i} a\nT{i} b{separator}{i}\n" for i in range(50)) + last + "\n")
        if last == "uint8 z":
            with pytest.raises(PayloadError, match="too few"):
                wide.leaves(mixed_payload())
        else:
            assert wide.leaves(mixed_payload()) == []
    deep = define("".join(f"T{i} a{separator}{i}\n" for i in range(3000)) + "uint8 z\n")
    with pytest.raises(PayloadError, match="nested deeper"):
        deep.leaves(mixed_payload())


def test_a_length_beyond_the_payload(mixed):
    payload = mixed_payload().replace(b"\x02\0\0\0", b"\xff\xff\xff\xff")
    with pytest.raises(PayloadError, match="too few"):
        mixed.read(payload, "len(e)")


@pytest.mark.parametrize("head", [b"\0\2", b"\0\3", b"\0\6", b"\0\7", b"\0\x0a", b"\1\1"])
def test_other_encapsulations_are_opaque(mixed, head):
    with pytest.raises(PayloadError, match="opaque: encapsulation"):
        mixed.leaves(head + mixed_payload()[2:])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("int8 a\nwstring b\nint8 c\n", r"opaque: wstring is not supported \(my_pkg/msg/Test: b\)"),
        ("int8 a\nwstring<=5[2] b\nint8 c\n", "opaque: wstring is not supported"),
        ("int8 a\nAbsent b\nint8 c\n", "opaque: type my_pkg/msg/Absent is unknown"),
        ("int8 a\nTest[] b\nint8 c\n", "opaque: type my_pkg/msg/Test contains itself"),
    ],
)
def test_opaque_parts(text, reason):
    kind = define(text)
    payload = b"\0\1\0\0\7\0\0\0\1\0\0\0abcd"
    assert re.match(reason, kind.opaque(payload))
    for act in (
        lambda: kind.leaves(payload),
        kind.fields,
        lambda: kind.read(payload, "c"),
        lambda: kind.patch(payload, {"c": 1}),
    ):
        with pytest.raises(PayloadError, match=reason):
            act()
    assert kind.read(payload, "a") == 7  # what comes before can be reached
    assert kind.patch(payload, {"a": 1}) == payload.replace(b"\7", b"\1")


def test_an_empty_sequence_of_opaque_parts_can_be_passed():
    kind = define("wstring[] b\nint8 c\n")
    assert kind.read(b"\0\1\0\0\0\0\0\0\5", "c") == 5
    with pytest.raises(PayloadError, match="opaque"):
        kind.rebuild(b"\0\1\0\0\0\0\0\0\5", {"len(b)": 1})


def test_an_unknown_type_is_opaque():
    kind = CdrType("my_pkg/msg/Absent", TypeStore())
    assert kind.opaque(b"\0\1\0\0") == "opaque: type my_pkg/msg/Absent is unknown"
    with pytest.raises(PayloadError, match="my_pkg/msg/Absent"):
        kind.parts()


def test_text_that_is_not_utf8_can_be_read_and_replaced(mixed):
    payload = mixed_payload(text=b"\xff\xfe\0")
    assert mixed.read(payload, "s") == "\udcff\udcfe"
    assert mixed.read(mixed.rebuild(payload, {"s": "longer"}), "s") == "longer"


def test_fields_are_those_that_others_read(tmp_path):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    from riot_bus.types.model import Schema

    adapter, decoders, seen = Ros2Adapter(), DecoderFactory(), {}
    with robot_bag(tmp_path / "bag.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            seen[channel.topic] = seen.get(channel.topic, 0) + 1
            kind = adapter.type_of_schema(Schema(schema.name, schema.encoding, schema.data))
            decoded = decoders.decoder_for("cdr", schema)(message.data)
            for leaf in kind.leaves(message.data, elements=1000):
                value = decoded
                for step in (
                    leaf.path.removeprefix("len(").removesuffix(")").replace("[", ".").replace("]", "").split(".")
                ):
                    value = value[int(step)] if step.isdigit() else getattr(value, step)
                assert (len(value) if leaf.path.startswith("len(") else value) == leaf.value
            assert kind.schema.name == schema.name
    assert seen["/odom"] == 50


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("value", [0, -1, 7, 300, 2**40, 1.5, math.inf, True])
def test_a_patcher_does_what_patch_does(mixed, order, value):
    payload = mixed_payload(order)
    compared = 0
    for leaf in mixed.leaves(payload):
        try:
            expected = mixed.patch(payload, {leaf.path: value})
            patcher = mixed.patcher(leaf.path, value)
        except PayloadError:
            continue
        if patcher is not None:
            assert patcher(payload) == expected
            with pytest.raises(PayloadError):
                patcher(payload[:4])
            compared += 1
    assert compared


def test_a_place_that_depends_on_the_payload_has_no_patcher(mixed):
    behind = [leaf.path for leaf in mixed.leaves(mixed_payload()) if leaf.type != "string"][-1]
    assert mixed.patcher(behind, 1) is None
