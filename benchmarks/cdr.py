"""What changing one field of a ROS 2 message costs, beside rosbags: `python benchmarks/cdr.py [--json FILE]`.

nav_msgs/Odometry: read a field, patch it, publish the message to a subscriber in another process, with an attachment as
rmw_zenoh has it. sensor_msgs/PointCloud2 of 64 KiB: patch a scalar. rosbags decodes and encodes the same messages, in
turn with ours. Microseconds per message: the median of many rounds, once of the processor's time that the calling
thread takes, by which the targets are judged, and once as the clock says, which tells how busy the machine was.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import statistics
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosbags.typesys import Stores, get_typestore

from riot_bus.zenoh.session import free_endpoint
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.attachment import Attachment, build_attachment

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    import zenoh

ROUNDS, BATCH = 400, 20
TIMEOUT_S = 30.0
KEY = "0/odom/nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported"
ODOMETRY, CLOUD = "nav_msgs/msg/Odometry", "sensor_msgs/msg/PointCloud2"
FIELD, LAST = "twist.twist.linear.x", "is_dense"
TARGETS = {"odometry: read + patch + publish": 15.0, "cloud 64 KiB: patch": 10.0}
RATIO = 0.5


def odometry() -> bytes:
    data = struct.pack("<iII", 1, 2, 5) + b"odom\0" + bytes(3) + struct.pack("<I", 10) + b"base_link\0"
    data += bytes(-len(data) % 8)
    return b"\0\1\0\0" + data + struct.pack("<85d", *range(85))


def cloud(size: int = 1 << 16) -> bytes:
    data = struct.pack("<iII", 1, 2, 4) + b"map\0" + struct.pack("<III", 1, size // 16, 3)
    for offset, name in zip((0, 4, 8), (b"x", b"y", b"z"), strict=True):
        data += struct.pack("<I", 2) + name + bytes(3) + struct.pack("<IB3xI", offset, 7, 1)
    return b"\0\1\0\0" + data + struct.pack("<B3xIII", 0, 16, size, size) + bytes(size) + b"\1"


def open_peer(**settings: Any) -> zenoh.Session:
    import zenoh

    config = zenoh.Config()
    for key, value in {"mode": "peer", "scouting/multicast/enabled": False, **settings}.items():
        config.insert_json5(key.replace("__", "/"), json.dumps(value))
    return zenoh.open(config)


def run_subscriber(pipe: Connection, endpoint: str) -> None:
    """Count what arrives until the pipe says how much it is, again and again."""
    import zenoh

    session = open_peer(listen__endpoints=[endpoint])
    seen = [0]

    def count(sample: zenoh.Sample) -> None:
        seen[0] += len(sample.payload) > 0

    subscriber = session.declare_subscriber(KEY, zenoh.handlers.Callback(count, indirect=False))
    pipe.send(None)
    while (wanted := pipe.recv()) is not None:
        deadline = time.monotonic() + TIMEOUT_S
        while seen[0] < wanted and time.monotonic() < deadline:
            time.sleep(0.0005)
        pipe.send(seen[0])
    subscriber.undeclare()  # type: ignore[no-untyped-call,unused-ignore]
    session.close()  # type: ignore[no-untyped-call,unused-ignore]


def contenders(put: Callable[[bytes], None]) -> dict[str, Callable[[], object]]:
    """Return what is measured; each takes one message."""
    adapter, store = Ros2Adapter(), get_typestore(Stores.ROS2_KILTED)
    odom, points = odometry(), cloud()
    kind, cloud_kind = adapter.type_named(ODOMETRY), adapter.type_named(CLOUD)
    assert kind is not None
    assert cloud_kind is not None
    assert kind.read(odom, FIELD) == 43.0
    assert cloud_kind.read(points, LAST) is True
    changes, cloud_changes = {FIELD: float("nan")}, {LAST: False}

    def read_and_patch() -> bytes:
        value = kind.read(odom, FIELD)
        assert isinstance(value, float)
        return kind.patch(odom, {FIELD: -value})

    def rosbags_odometry() -> bytes | memoryview:
        message: Any = store.deserialize_cdr(odom, ODOMETRY)
        message.twist.twist.linear.x = -message.twist.twist.linear.x
        return store.serialize_cdr(message, ODOMETRY)

    def rosbags_cloud() -> bytes | memoryview:
        message: Any = store.deserialize_cdr(points, CLOUD)
        message.is_dense = False
        return store.serialize_cdr(message, CLOUD)

    assert bytes(rosbags_odometry()) == read_and_patch()
    assert bytes(rosbags_cloud()) == cloud_kind.patch(points, cloud_changes)
    return {
        "odometry: read": lambda: kind.read(odom, FIELD),
        "odometry: patch": lambda: kind.patch(odom, changes),
        "odometry: read + patch": read_and_patch,
        "odometry: all fields": lambda: kind.leaves(odom),
        "odometry: read + patch + publish": lambda: put(read_and_patch()),
        "odometry: publish": lambda: put(odom),
        "odometry: rosbags decode + encode": rosbags_odometry,
        "odometry: rosbags decode + encode + publish": lambda: put(bytes(rosbags_odometry())),
        "odometry: other frame_id": lambda: kind.rebuild(odom, {"header.frame_id": "map"}),
        "cloud 64 KiB: patch": lambda: cloud_kind.patch(points, cloud_changes),
        "cloud 64 KiB: rosbags decode + encode": rosbags_cloud,
    }


def measure(rounds: int) -> tuple[dict[str, float], dict[str, float]]:
    """Return microseconds per message, of processor's time and of the clock."""
    import zenoh

    endpoint = free_endpoint()
    context = multiprocessing.get_context("spawn")
    pipe, other = context.Pipe()
    child = context.Process(target=run_subscriber, args=(other, endpoint), daemon=True)
    child.start()
    pipe.recv()
    session = open_peer(connect__endpoints=[endpoint])
    publisher = session.declare_publisher(KEY, congestion_control=zenoh.CongestionControl.BLOCK)
    deadline = time.monotonic() + TIMEOUT_S
    while not publisher.matching_status.matching and time.monotonic() < deadline:
        time.sleep(0.01)
    attachment = build_attachment(Attachment(1, 2, bytes(16)))
    sent = 0

    def put(payload: bytes) -> None:
        nonlocal sent
        sent += 1
        publisher.put(payload, attachment=attachment)

    found: dict[str, list[tuple[int, int]]] = {}
    acts = contenders(put)
    try:
        for _ in range(rounds):
            for name, act in acts.items():
                begin, cpu = time.perf_counter_ns(), time.thread_time_ns()
                for _ in range(BATCH):
                    act()
                cpu, wall = time.thread_time_ns() - cpu, time.perf_counter_ns() - begin
                found.setdefault(name, []).append((cpu, wall))
                if "publish" in name:  # the next one does not wait for this one's messages
                    pipe.send(sent)
                    arrived = pipe.recv()
                    assert arrived >= sent, f"{arrived} of {sent} messages arrived"
        pipe.send(None)
    finally:
        publisher.undeclare()  # type: ignore[no-untyped-call,unused-ignore]
        session.close()  # type: ignore[no-untyped-call,unused-ignore]
        child.join(TIMEOUT_S)
    cpu, wall = (
        {name: statistics.median(each[column] for each in values) / BATCH / 1000 for name, values in found.items()}
        for column in (0, 1)
    )
    return cpu, wall


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"of {BATCH} messages each")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    args = parser.parse_args()
    found, wall = measure(args.rounds)
    ratios = {
        "odometry": found["odometry: read + patch"] / found["odometry: rosbags decode + encode"],
        "odometry, published": found["odometry: read + patch + publish"]
        / found["odometry: rosbags decode + encode + publish"],
        "cloud 64 KiB": found["cloud 64 KiB: patch"] / found["cloud 64 KiB: rosbags decode + encode"],
    }
    for name, value in found.items():
        target = f"  (target {TARGETS[name]:.0f})" if name in TARGETS else ""
        print(f"{name:46}{value:8.2f} us, by the clock {wall[name]:8.2f} us{target}")
    for name, value in ratios.items():
        target = f"  (target {RATIO})" if name != "odometry, published" else ""
        print(f"{'ratio to rosbags: ' + name:46}{value:8.2f}{target}")
    if args.json is not None:
        args.json.write_text(json.dumps({"us": found, "clock_us": wall, "ratio": ratios}, indent=2))
    missed = [name for name, target in TARGETS.items() if found[name] > target]
    missed += [name for name, value in ratios.items() if value > RATIO and name != "odometry, published"]
    if missed:
        sys.exit(f"missed: {', '.join(missed)}")


if __name__ == "__main__":
    main()
