"""A ROS 2 bag of a robot that drives, as rosbag2 writes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from riot_bus_ros2.store import TypeStore
from tests.bags import FOREVER, VOLATILE, write_bag

BEGIN, MS, SECOND = 1_700_000_000_000_000_000, 1_000_000, 1_000_000_000
LASTING = f"  liveliness: automatic\n{FOREVER}  avoid_ros_namespace_conventions: false\n"
LATCHED_ONE = f"- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n{LASTING}"
STRING, ODOMETRY, TF, GRID = (
    "std_msgs/msg/String",
    "nav_msgs/msg/Odometry",
    "tf2_msgs/msg/TFMessage",
    "nav_msgs/msg/OccupancyGrid",
)


class Robot:
    """Makes the messages of a robot that drives."""

    def __init__(self) -> None:
        self.types = get_typestore(Stores.ROS2_JAZZY)

    def __call__(self, name: str, **fields: Any) -> Any:
        return self.types.types[name](**fields)

    def header(self, time: int, frame: str) -> Any:
        stamp = self("builtin_interfaces/msg/Time", sec=time // SECOND, nanosec=time % SECOND)
        return self("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def pose(self, x: float) -> Any:
        position = self("geometry_msgs/msg/Point", x=x, y=-x, z=0.0)
        orientation = self("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        return self("geometry_msgs/msg/Pose", position=position, orientation=orientation)

    def vector(self, z: float) -> Any:
        return self("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=z)

    def odometry(self, time: int, number: int) -> bytes:
        twist = self("geometry_msgs/msg/Twist", linear=self.vector(0.0), angular=self.vector(-number / 4))
        message = self(
            ODOMETRY,
            header=self.header(time, "odom"),
            child_frame_id="base",
            pose=self("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(number / 8), covariance=np.arange(36.0)),
            twist=self("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )
        return bytes(self.types.serialize_cdr(message, ODOMETRY))

    def transform(self, time: int, frame: str, w: float) -> bytes:
        rotation = self("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=w)
        inner = self("geometry_msgs/msg/Transform", translation=self.vector(0.5), rotation=rotation)
        header = self.header(time, frame)
        stamped = self("geometry_msgs/msg/TransformStamped", header=header, child_frame_id="x", transform=inner)
        return bytes(self.types.serialize_cdr(self(TF, transforms=[stamped]), TF))

    def map(self, time: int) -> bytes:
        load = self("builtin_interfaces/msg/Time", sec=0, nanosec=0)
        info = self(
            "nav_msgs/msg/MapMetaData", map_load_time=load, resolution=0.5, width=2, height=2, origin=self.pose(0.0)
        )
        cells = np.array([0, 100, -1, 7], dtype=np.int8)
        message = self(GRID, header=self.header(time, "map"), info=info, data=cells)
        return bytes(self.types.serialize_cdr(message, GRID))


def robot_bag(path: Path, count: int = 50, **options: Any) -> Path:
    """A robot drives; map, static transforms and description were published once, at the beginning.

    Args:
        path: The file.
        count: Number of messages of odometry, and of transforms, in steps of 20 ms.
        options: How the file is written, for `mcap.writer.Writer`.
    """
    robot, store = Robot(), TypeStore()
    kinds = {
        "/odom": (VOLATILE + LASTING, ODOMETRY),
        "/tf": (VOLATILE + LASTING, TF),
        "/tf_static": (LATCHED_ONE + LATCHED_ONE, TF),
        "/map": (LATCHED_ONE, GRID),
        "/robot_description": (LATCHED_ONE, STRING),
    }
    topics = {
        topic: (qos, store.type_hash(name), name, store.schema(name).data.decode())
        for topic, (qos, name) in kinds.items()
    }
    log: list[tuple[int, str, str | bytes]] = [
        (BEGIN, "/tf_static", robot.transform(BEGIN, "base", 0.25)),
        (BEGIN, "/tf_static", robot.transform(BEGIN, "laser", 0.5)),
        (BEGIN, "/map", robot.map(BEGIN)),
        (BEGIN, "/robot_description", "<robot name='rover'/>"),
    ]
    for number in range(count):
        time = BEGIN + (1 + number) * 20 * MS
        log.append((time, "/odom", robot.odometry(time, number)))
        log.append((time, "/tf", robot.transform(time, "odom", number / count)))
    return write_bag(path, topics, log, **options)
