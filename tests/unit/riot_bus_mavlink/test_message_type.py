import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.types.bulk import gather
from riot_bus.types.capabilities import (
    AllowsNonFinite,
    DescribesFields,
    GathersFields,
    KnowsBrittleFields,
    SuggestsValues,
)
from riot_bus.types.model import Leaf
from riot_bus.types.payloads import Payloads
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import V1, V2, Framer, pack_frame, parse_frame, seal
from riot_bus_mavlink.message_type import MavlinkType
from riot_bus_mavlink.signing import Signer
from riot_bus_testkit.types import HostileConformance, TypeConformance, same_leaf
from tests.tiers import scaled
from tests.unit.riot_bus_mavlink.signed_frames import sign_frame

ALL = load_dialect()
KEY = bytes(32)


def kind(name, **more):
    return MavlinkType(ALL.message(name), ALL.enums, **more)


def frame(name, body, version=2):
    message = ALL.message(name)
    return pack_frame(message.id, body, message.crc_extra, version=version, sequence=9, system=1, component=2)


ATTITUDE = frame("ATTITUDE", struct.pack("<I6f", 1234, 0.1, 0.2, 0.3, 0.4, 0.5, 0.0))
SERVOS = bytes(range(1, 38))
SIGNED = sign_frame(ATTITUDE, Signer(KEY), ALL.message("ATTITUDE").crc_extra, link=3, time=77)


class TestAttitude(TypeConformance):
    kind = kind("ATTITUDE", signer=Signer(KEY))
    payloads = (
        ATTITUDE,
        SIGNED,
        frame("ATTITUDE", struct.pack("<I6f", 1, math.nan, math.inf, -0.0, 1e30, 2.0, 3.0), 1),
        frame("ATTITUDE", b"\0"),
    )
    widest = 280


class TestArraysAndExtensions(TypeConformance):
    kind = kind("BATTERY_STATUS")
    payloads = (frame("BATTERY_STATUS", bytes(range(1, 55))), frame("BATTERY_STATUS", bytes(range(1, 37)), 1))
    widest = 280


class TestBytes(TypeConformance):
    kind = kind("GPS_RTCM_DATA")
    payloads = (frame("GPS_RTCM_DATA", bytes([1, 4, 9, 8, 7, 6])),)
    widest = 280


class TestTwoLongWords(TypeConformance):
    kind = kind("TIMESYNC")
    payloads = (frame("TIMESYNC", bytes(range(100, 118))), frame("TIMESYNC", bytes(range(100, 116)), 1))
    widest = 280


class TestText(HostileConformance):
    kind = kind("STATUSTEXT")
    payloads = (frame("STATUSTEXT", b"\4ready" + bytes(45) + b"\1\0\2"), frame("STATUSTEXT", b"\4" + b"A" * 50, 1))


@settings(deadline=None, max_examples=scaled(500))
@given(data=st.data())
def test_any_payload_under_a_right_checksum(data):
    message = data.draw(st.sampled_from(sorted(ALL.messages.values(), key=lambda each: each.id)))
    old = message.id < 256 and data.draw(st.booleans())
    body = data.draw(st.binary(max_size=255))
    head = bytes([V1, len(body), 1, 2, 3, message.id]) if old else bytes([V2, len(body), 0, 9, 1, 2, 3])
    raw = seal(head if old else head + message.id.to_bytes(3, "little"), body, message.crc_extra)
    one = MavlinkType(message, ALL.enums)
    if one.opaque(raw) is not None:
        assert old
        assert len(body) < message.base_size
        with pytest.raises(PayloadError):
            one.leaves(raw)
        return
    leaves = one.leaves(raw, elements=255)
    for leaf in data.draw(st.lists(st.sampled_from(leaves), max_size=3)):
        before = one.read(raw, leaf.path)
        after = one.patch(raw, {leaf.path: before})
        assert same_leaf(Leaf(leaf.path, leaf.type, one.read(after, leaf.path)), leaf)
        changed = one.patch(raw, {leaf.path: "x" if leaf.type == "string" else 1})
        pairs = zip(one.leaves(changed, elements=255), leaves, strict=True)
        assert all(same_leaf(*pair) for pair in pairs if pair[0].path != leaf.path)
        assert Framer(ALL.crc_extra).feed(changed)[0].raw == changed
        one.exceptional(raw, leaf.path)


def test_columns_have_the_type_of_their_field():
    one = kind("BATTERY_STATUS")
    first, old = TestArraysAndExtensions.payloads
    frames = [first, old, b"junk", frame("BATTERY_STATUS", bytes(54))]
    sizes = np.array([len(each) for each in frames])
    many = Payloads(b"".join(frames), np.cumsum(sizes) - sizes, sizes)
    for path, dtype in (("voltages[1]", "uint16"), ("header.system_id", "uint8"), ("len(voltages)", "uint32")):
        found = gather(one, many, path)
        assert (found.values.dtype, found.valid.tolist()) == (dtype, [True, True, False, True])
        assert found.values[[0, 1, 3]].tolist() == [one.read(each, path) for each in frames if each != b"junk"]
    assert gather(one, many, "mode").valid.tolist() == [True, False, False, True]
    angle = gather(kind("ATTITUDE"), Payloads(ATTITUDE, np.zeros(1, int), np.array([len(ATTITUDE)])), "roll")
    assert (angle.values.dtype, angle.values.tolist()) == ("float32", [struct.unpack("f", struct.pack("f", 0.1))[0]])
    text = gather(kind("STATUSTEXT"), Payloads(b"x", np.array([0]), np.array([1])), "text")
    assert (text.values.tolist(), text.valid.tolist()) == ([None], [False])
    with pytest.raises(PayloadError):
        gather(one, many, "nothing")
    assert isinstance(one, GathersFields)


def test_protocols():
    one = kind("HEARTBEAT")
    assert isinstance(one, DescribesFields)
    assert isinstance(one, SuggestsValues)
    assert isinstance(one, KnowsBrittleFields)


@pytest.mark.parametrize(
    ("name", "allowed", "others"),
    [
        ("COMMAND_LONG", ["param1", "param7"], ["command", "confirmation", "nothing"]),
        ("COMMAND_INT", ["param4", "z"], ["x", "frame"]),
        ("MISSION_ITEM_INT", ["param1"], ["y", "seq"]),
        ("ODOMETRY", ["pose_covariance[0]", "pose_covariance[1]"], ["x", "q[0]"]),
        ("ATTITUDE", [], ["roll", "time_boot_ms"]),
    ],
)
def test_nan_means_not_used_or_not_known(name, allowed, others):
    one = kind(name)
    assert isinstance(one, AllowsNonFinite)
    assert [path for path in (*allowed, *others) if one.allows_non_finite(path)] == allowed


def test_fields_in_the_order_of_the_definition():
    found = {field.path: field for field in kind("GLOBAL_POSITION_INT").fields()}
    assert list(found)[:5] == ["header.sequence", "header.system_id", "header.component_id", "time_boot_ms", "lat"]
    assert (found["lat"].type, found["lat"].unit) == ("int32", "degE7")
    heartbeat = {field.path: field for field in kind("HEARTBEAT").fields()}
    assert (heartbeat["base_mode"].low, heartbeat["base_mode"].high) == (0, 255)
    assert heartbeat["system_status"].high == 8
    assert (4, "MAV_STATE_ACTIVE") in heartbeat["system_status"].names
    assert found["lat"].names == ()
    text = {field.path: field for field in kind("STATUSTEXT").fields()}
    assert (text["text"].type, text["text"].high, text["text"].length) == ("string", 50, 0)
    rtcm = {field.path: field for field in kind("GPS_RTCM_DATA").fields()}
    assert (rtcm["data[*]"].type, rtcm["data[*]"].length) == ("uint8", 180)


def test_zeros_are_cut_and_come_back():
    one = kind("ATTITUDE")
    zeroed = one.patch(ATTITUDE, {"pitchspeed": 0.0, "rollspeed": 0})
    assert zeroed[1] == 16
    again = one.patch(zeroed, {"yawspeed": 1.0})
    assert (again[1], one.read(again, "yawspeed"), one.read(again, "pitchspeed")) == (28, 1.0, 0.0)
    empty = one.patch(ATTITUDE, {leaf.path: 0 for leaf in one.leaves(ATTITUDE)[3:]})
    assert empty[1] == 1
    assert one.read(empty, "yaw") == 0.0


def test_a_sender_that_does_not_cut_zeros_is_left_as_it_is():
    message = ALL.message("ATTITUDE")
    head = bytes([V2, 28, 0, 0, 1, 1, 1, message.id, 0, 0])
    raw = seal(head, bytes(28), message.crc_extra)
    one = kind("ATTITUDE")
    assert one.patch(raw, {"roll": 0.0}) == raw
    assert one.patch(raw, {"roll": 1.0})[1] == 28


def test_newer_messages_keep_what_is_not_known_here():
    message = ALL.message("ATTITUDE")
    raw = frame("ATTITUDE", bytes(28) + b"new")
    one = kind("ATTITUDE")
    changed = one.patch(raw, {"roll": 2.0})
    assert parse_frame(changed).payload[28:] == b"new"
    assert len(one.leaves(raw)) == 3 + len(message.places)


def test_the_header():
    one = kind("ATTITUDE")
    for raw in (ATTITUDE, frame("ATTITUDE", bytes(range(1, 29)), 1)):
        assert (one.read(raw, "header.sequence"), one.read(raw, "header.system_id")) == (9, 1)
        changed = one.patch(raw, {"header.component_id": 300, "header.sequence": -1})
        parsed = parse_frame(changed)
        assert (parsed.component, parsed.sequence, parsed.system) == (44, 255, 1)
        assert Framer(ALL.crc_extra).feed(changed) == [parsed]
    assert one.brittle("header.sequence") == "sequence number"


def test_text_ends_at_a_nul_and_is_cut_to_its_field():
    one = kind("PARAM_VALUE")
    raw = frame("PARAM_VALUE", struct.pack("<fHH16sB", 1.5, 3, 2, b"ALT\0HIDDEN", 9))
    assert one.read(raw, "param_id") == "ALT"
    assert one.patch(raw, {"param_id": "ALT"})[18:34] == b"ALT".ljust(16, b"\0")
    full = one.patch(raw, {"param_id": "A" * 5_000})
    assert one.read(full, "param_id") == "A" * 16
    odd = one.patch(raw, {"param_id": "é\udcff"})
    assert one.read(odd, "param_id") == "é\udcff"
    for value in (3, b"A", math.nan):
        with pytest.raises(PayloadError, match="not text"):
            one.patch(raw, {"param_id": value})
    with pytest.raises(PayloadError, match="encoded"):
        one.patch(raw, {"param_id": "\ud800"})


@pytest.mark.parametrize("path", ["nothing", "roll[0]", "len(roll)", "header", "header.crc", "len(", "roll.x", "[", ""])
def test_fields_that_are_not_there(path):
    one = kind("ATTITUDE")
    for act in (lambda: one.read(ATTITUDE, path), lambda: one.patch(ATTITUDE, {path: 1}), lambda: one.patcher(path, 1)):
        with pytest.raises(PayloadError):
            act()


def test_arrays_have_a_fixed_length():
    one = kind("GPS_RTCM_DATA")
    raw = TestBytes.payloads[0]
    assert one.read(raw, "len(data)") == 180
    with pytest.raises(PayloadError, match="fixed length"):
        one.patch(raw, {"len(data)": 3})
    with pytest.raises(PayloadError, match="no such field"):
        one.read(raw, "data[180]")


def test_extensions_of_old_frames():
    one = kind("BATTERY_STATUS")
    old = TestArraysAndExtensions.payloads[1]
    assert "mode" not in {leaf.path for leaf in one.leaves(old)}
    with pytest.raises(PayloadError, match="MAVLink 1 has no such field"):
        one.read(old, "mode")
    with pytest.raises(PayloadError, match="MAVLink 1 has no such field"):
        one.patch(old, {"mode": 1})
    long = frame("BATTERY_STATUS", bytes(range(1, 55)), 1)  # as some senders do
    assert one.read(long, "fault_bitmask") == struct.unpack_from("<I", bytes(range(1, 55)), 50)[0]


def test_damaged_and_foreign_frames_are_opaque():
    one = kind("ATTITUDE")
    broken = ATTITUDE[:-1] + bytes([ATTITUDE[-1] ^ 1])
    for raw, why in (
        (broken, "checksum"),
        (frame("HEARTBEAT", bytes(range(9))), "message 0 instead of 30, ATTITUDE"),
        (ATTITUDE + b"\0", "MAVLink 2"),
        (frame("ATTITUDE", b"abc", 1), "3 bytes instead of 28"),
        (b"", "not a frame"),
    ):
        assert why in one.opaque(raw)
        for act in (lambda raw=raw: one.leaves(raw), lambda raw=raw: one.patch(raw, {"roll": 1.0})):
            with pytest.raises(PayloadError, match=why):
                act()


def test_signed_frames_need_the_key_to_be_changed():
    without = kind("ATTITUDE")
    assert without.read(SIGNED, "roll") == without.read(ATTITUDE, "roll")
    assert without.patch(SIGNED, {}) == SIGNED
    with pytest.raises(PayloadError, match="without the key"):
        without.patch(SIGNED, {"roll": 1.0})
    with pytest.raises(PayloadError, match="wrong signature"):
        kind("ATTITUDE", signer=Signer(b"\1" * 32)).patch(SIGNED, {"roll": 1.0})
    changed = kind("ATTITUDE", signer=Signer(KEY)).patch(SIGNED, {"roll": 1.0})
    assert Signer(KEY).made(changed)
    assert changed[-13:-6] == SIGNED[-13:-6]


def test_the_patcher_is_the_patch():
    one = kind("ATTITUDE")
    assert one.patcher("header.sequence", 3) is None
    assert one.patcher("roll", 2.5)(ATTITUDE) == one.patch(ATTITUDE, {"roll": 2.5})
    with pytest.raises(PayloadError):
        one.patcher("roll", 2.5)(ATTITUDE[:-1])
    extended = kind("BATTERY_STATUS").patcher("mode", 3)
    with pytest.raises(PayloadError, match="MAVLink 1 has no such field"):
        extended(TestArraysAndExtensions.payloads[1])
