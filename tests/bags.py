"""ROS 2 bags as rosbag2 writes them, for tests."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mcap.writer import Writer

STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING_KEY = f"std_msgs::msg::dds_::String_/{STRING_HASH}"
VOLATILE = "- history: keep_last\n  depth: 10\n  reliability: reliable\n  durability: volatile\n"
LATCHED = "- history: 1\n  depth: 2\n  reliability: 1\n  durability: 1\n"
FOREVER = "".join(
    f"  {name}:\n    sec: 9223372036\n    nsec: 854775807\n"
    for name in ("deadline", "lifespan", "liveliness_lease_duration")
)


def text(value: str) -> bytes:
    """A std_msgs/msg/String."""
    data = value.encode() + b"\0"
    return b"\0\1\0\0" + len(data).to_bytes(4, "little") + data


def write_bag(
    path: Path, topics: Mapping[str, tuple[str, ...]], messages: Iterable[tuple[int, str, str | bytes]], **options: Any
) -> Path:
    """A bag of strings.

    Args:
        path: The file.
        topics: Offered QoS and type hash by name; a type `pkg/msg/Name` and its definition may follow.
        messages: Time, topic, and text or payload.
        options: How the file is written, for `mcap.writer.Writer`.
    """
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros2", library="rosbag2")
        channels = {}
        for name, (qos, type_hash, *kind) in topics.items():
            type_name, definition = kind or ("std_msgs/msg/String", "string data\n")
            schema = writer.register_schema(type_name, "ros2msg", definition.encode())
            details = {"offered_qos_profiles": qos, "topic_type_hash": type_hash}
            channels[name] = writer.register_channel(name, "cdr", schema, details)
        for time, name, value in messages:
            writer.add_message(channels[name], time, text(value) if isinstance(value, str) else value, time)
        writer.finish()  # type: ignore[no-untyped-call]
    return path
