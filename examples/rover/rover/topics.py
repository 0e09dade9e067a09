"""What travels on which topic, and the keys that rmw_zenoh gives to topics."""

from __future__ import annotations

from rover.maps import OccupancyGrid, OccupancyGridUpdate
from rover.messages import Path, PoseStamped, Twist
from rover.sensors import BatteryState, Imu, Joy, NavSatFix, Odometry

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rover.messages import Message

DOMAIN = 0

TOPICS: dict[str, type[Message]] = {
    "/odom": Odometry,
    "/imu": Imu,
    "/gps/fix": NavSatFix,
    "/battery_state": BatteryState,
    "/joy": Joy,
    "/goal": PoseStamped,
    "/map": OccupancyGrid,
    "/map_updates": OccupancyGridUpdate,
    "/plan": Path,
    "/cmd_vel": Twist,
}


def key(topic: str) -> str:
    """Give the Zenoh key of a topic: domain, name, DDS type and type hash."""
    message = TOPICS[topic]
    package, kind, name = message.TYPE.split("/")
    return f"{DOMAIN}/{topic.strip('/')}/{package}::{kind}::dds_::{name}_/{message.HASH}"
