"""Fields of common messages in which NaN or an infinity is a regular value."""

from __future__ import annotations

import re
from typing import Final

__all__ = ["allows_non_finite"]

_FIELDS: Final = {
    "sensor_msgs/msg/BatteryState": (
        r"voltage|temperature|current|charge|capacity|design_capacity|percentage|cell_(voltage|temperature)\[.*"
    ),
    "sensor_msgs/msg/LaserScan": r"(ranges|intensities)\[.*",
    "sensor_msgs/msg/MagneticField": r"magnetic_field\.[xyz]",
    "sensor_msgs/msg/MultiEchoLaserScan": r"(ranges|intensities)\[.*",
    "sensor_msgs/msg/NavSatFix": r"altitude",
    "sensor_msgs/msg/Range": r"range",
}
"""Taken from comments in the definitions; ranges from REP 117 (https://ros.org/reps/rep-0117.html)."""


def allows_non_finite(type_name: str, path: str) -> bool:
    """Return whether NaN or an infinity in a field means "not measured", "no echo" or the like.

    Args:
        type_name: Name of the type, such as `sensor_msgs/msg/LaserScan`.
        path: Path of a field, or of an element of an array.
    """
    fields = _FIELDS.get(type_name)
    return fields is not None and re.fullmatch(fields, path) is not None
