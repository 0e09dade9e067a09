import pytest

from riot_bus.types.brittle import is_brittle, why_brittle


@pytest.mark.parametrize(
    "path",
    [
        "header.stamp.sec",
        "header.frame_id",
        "child_frame_id",
        "poses[3].header.stamp.nanosec",
        "seq",
        "sequence_number",
        "seqNo",
        "timestamp",
        "timestamp_us",
        "time_boot_ms",
        "time_usec",
        "crc32",
        "checksum",
        "mavlink_version",
        "magic",
        "protocol",
        "len(signature)",
    ],
)
def test_left_alone(path):
    assert is_brittle(path)


@pytest.mark.parametrize(
    "path",
    [
        "twist.linear.x",
        "time_to_collision",
        "ranges[3]",
        "consequence",
        "mode",
        "frame",
        "subsequent",
        "len(ranges)",
        "scan_time",
    ],
)
def test_injectable(path):
    assert is_brittle(path) is None


def test_some_types_are_nothing_but_a_stamp():
    assert is_brittle("clock.sec", "rosgraph_msgs/msg/Clock") == "timestamp"
    assert is_brittle("pose.x", "geometry_msgs/msg/Pose") is None


class Telling:
    """A type that knows which of its fields receivers check."""

    def brittle(self, path):
        return {"seq": "", "mode": "address"}.get(path)


def test_a_type_knows_better_than_names():
    assert why_brittle("seq") == "sequence number"
    assert why_brittle("seq", Telling()) is None
    assert why_brittle("mode", Telling()) == "address"
    assert why_brittle("crc", Telling()) == "checksum"
    assert why_brittle("speed", Telling()) is None
    assert why_brittle("speed", object()) is None
