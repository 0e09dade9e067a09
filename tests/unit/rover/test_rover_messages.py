import random
import struct
from pathlib import Path

import pytest
import rosbags.typesys.store as store
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rover.cdr import DecodeError
from rover.maps import OccupancyGrid, OccupancyGridUpdate
from rover.messages import Path as Plan
from rover.messages import PoseStamped, Twist
from rover.sensors import BatteryState, Imu, Joy, NavSatFix, Odometry
from rover.topics import TOPICS, key

UPDATE_TEXT = Path(__file__).parents[3] / "examples/rover/map_msgs/msg/OccupancyGridUpdate.msg"


@pytest.fixture(scope="module")
def types():
    typestore = get_typestore(Stores.ROS2_JAZZY)
    typestore.register(get_types_from_msg(UPDATE_TEXT.read_text(), OccupancyGridUpdate.TYPE))
    return typestore


def samples(rng):
    def number():
        return rng.uniform(-1e6, 1e6)

    stamp = rng.randrange(-(2**31), 2**31), rng.randrange(2**32)
    cells = bytes(rng.randrange(256) for _ in range(rng.randrange(9)))
    corner = rng.randrange(-(2**31), 2**31), rng.randrange(-(2**31), 2**31)
    goal = PoseStamped(stamp, number(), number(), (number(), number()))
    return [
        Twist(number(), number()),
        goal,
        Plan(stamp, [PoseStamped(stamp, number(), number()) for _ in range(rng.randrange(4))]),
        OccupancyGrid(stamp, 0.5, len(cells), 1, number(), number(), cells),
        OccupancyGridUpdate(stamp, *corner, 1, len(cells), cells),
        Odometry(stamp, number(), number(), number(), number()),
        Imu(stamp, (number(), number(), number()), (number(), number(), number())),
        NavSatFix(stamp, (number(), number(), number())),
        BatteryState(stamp, number(), number(), number(), number()),
        Joy(stamp, [number() for _ in range(rng.randrange(5))], [rng.randrange(2**31) for _ in range(3)]),
    ]


def test_hashes_are_those_of_ros(types, monkeypatch):
    monkeypatch.setitem(store.TIDMAP, "char", 3)
    for message in TOPICS.values():
        assert types.hash_rihs01(message.TYPE) == message.HASH


def test_keys_are_those_of_rmw_zenoh():
    assert key("/gps/fix") == f"0/gps/fix/sensor_msgs::msg::dds_::NavSatFix_/{NavSatFix.HASH}"


def test_bytes_are_those_of_another_codec(types):
    rng = random.Random(1)
    for _ in range(50):
        for message in samples(rng):
            raw = message.encode()
            theirs = types.deserialize_cdr(raw, message.TYPE)
            assert bytes(types.serialize_cdr(theirs, message.TYPE)) == raw


def test_decode_gives_back_what_was_encoded():
    rng = random.Random(2)
    for message in samples(rng)[:6]:
        raw = message.encode()
        assert type(message).decode(raw).encode() == raw
        assert type(message).decode(raw + b"tail").encode() == raw


def test_values_are_where_another_codec_sees_them(types):
    odometry = types.deserialize_cdr(Odometry((7, 8), 1.0, 2.0, 3.0, 4.0).encode(), Odometry.TYPE)
    assert (odometry.header.stamp.sec, odometry.header.stamp.nanosec) == (7, 8)
    assert (odometry.pose.pose.position.x, odometry.pose.pose.position.y) == (1.0, 2.0)
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.linear.y) == (3.0, 4.0)
    odometry.header.frame_id = "a longer frame"
    odometry.twist.twist.linear.y = -4.5
    ours = Odometry.decode(bytes(types.serialize_cdr(odometry, Odometry.TYPE)))
    assert (ours.stamp, ours.x, ours.y, ours.vx, ours.vy) == ((7, 8), 1.0, 2.0, 3.0, -4.5)
    update = types.deserialize_cdr(OccupancyGridUpdate((0, 0), -3, 5, 2, 1, b"\xff\x00").encode(), UPDATE)
    assert (update.x, update.y, update.width, update.height, list(update.data)) == (-3, 5, 2, 1, [-1, 0])
    fix = types.deserialize_cdr(NavSatFix((0, 0), (40.5, -79.5, 280.0)).encode(), NavSatFix.TYPE)
    assert (fix.latitude, fix.longitude, fix.altitude) == (40.5, -79.5, 280.0)


UPDATE = OccupancyGridUpdate.TYPE


def test_a_short_message_is_refused_at_every_length():
    for message in samples(random.Random(3))[:6]:
        raw = message.encode()
        for size in range(len(raw)):
            with pytest.raises(DecodeError):
                type(message).decode(raw[:size])


def test_attachment_is_rmw_zenoh_version_2():
    from rover.bus import attachment

    raw = attachment(5, 1_700_000_000_000_000_001, bytes(range(16)))
    assert len(raw) == 33
    assert struct.unpack("<qqB", raw[:17]) == (5, 1_700_000_000_000_000_001, 16)
    assert raw[17:] == bytes(range(16))
