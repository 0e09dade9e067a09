"""Fields of common_interfaces: units, and whether NaN is a regular value; from their comments, REP 103 and REP 117."""

from __future__ import annotations

import re

_VELOCITY = {"linear": "m/s", "angular": "rad/s"}
_ACCELERATION = {"linear": "m/s^2", "angular": "rad/s^2"}
_METRES = {"x": "m", "y": "m", "z": "m"}
_TIME = {"sec": "s", "nanosec": "ns"}

UNITS: dict[str, dict[str, str]] = {
    "builtin_interfaces/msg/Duration": _TIME,
    "builtin_interfaces/msg/Time": _TIME,
    "geometry_msgs/msg/Accel": _ACCELERATION,
    "geometry_msgs/msg/Inertia": {
        "m": "kg", "com": "m", "ixx": "kg m^2", "ixy": "kg m^2", "ixz": "kg m^2", "iyy": "kg m^2", "iyz": "kg m^2",
        "izz": "kg m^2",
    },
    "geometry_msgs/msg/Point": _METRES,
    "geometry_msgs/msg/Point32": _METRES,
    "geometry_msgs/msg/Pose2D": {"x": "m", "y": "m", "theta": "rad"},
    "geometry_msgs/msg/Transform": {"translation": "m"},
    "geometry_msgs/msg/Twist": _VELOCITY,
    "geometry_msgs/msg/Wrench": {"force": "N", "torque": "Nm"},
    "nav_msgs/msg/GridCells": {"cell_width": "m", "cell_height": "m"},
    "nav_msgs/msg/MapMetaData": {"resolution": "m"},
    "sensor_msgs/msg/BatteryState": {
        "voltage": "V", "temperature": "degC", "current": "A", "charge": "Ah", "capacity": "Ah",
        "design_capacity": "Ah", "cell_voltage": "V", "cell_temperature": "degC",
    },
    "sensor_msgs/msg/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/msg/Illuminance": {"illuminance": "lx"},
    "sensor_msgs/msg/Imu": {"angular_velocity": "rad/s", "linear_acceleration": "m/s^2"},
    "sensor_msgs/msg/LaserScan": {
        "angle_min": "rad", "angle_max": "rad", "angle_increment": "rad", "time_increment": "s", "scan_time": "s",
        "range_min": "m", "range_max": "m", "ranges": "m",
    },
    "sensor_msgs/msg/MagneticField": {"magnetic_field": "T"},
    "sensor_msgs/msg/MultiEchoLaserScan": {
        "angle_min": "rad", "angle_max": "rad", "angle_increment": "rad", "time_increment": "s", "scan_time": "s",
        "range_min": "m", "range_max": "m", "ranges": "m",
    },
    "sensor_msgs/msg/NavSatFix": {"latitude": "deg", "longitude": "deg", "altitude": "m"},
    "sensor_msgs/msg/Range": {"field_of_view": "rad", "min_range": "m", "max_range": "m", "range": "m"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
    "shape_msgs/msg/SolidPrimitive": {"dimensions": "m"},
    "stereo_msgs/msg/DisparityImage": {"t": "m", "f": "px", "min_disparity": "px", "max_disparity": "px"},
    "visualization_msgs/msg/Marker": {"scale": "m"},
}  # fmt: skip
"""Unit by type and field; fields of a type without own units, such as `Vector3`, take the enclosing field's unit."""

_NON_FINITE = {
    "sensor_msgs/msg/BatteryState": (
        r"voltage|temperature|current|charge|capacity|design_capacity|percentage|cell_(voltage|temperature)\[.*"
    ),
    "sensor_msgs/msg/LaserScan": r"(ranges|intensities)\[.*",
    "sensor_msgs/msg/MagneticField": r"magnetic_field\.[xyz]",
    "sensor_msgs/msg/MultiEchoLaserScan": r"(ranges|intensities)\[.*",
    "sensor_msgs/msg/NavSatFix": r"altitude",
    "sensor_msgs/msg/Range": r"range",
}
"""Paths in which NaN or an infinity is a regular value; ranges are from https://ros.org/reps/rep-0117.html."""


def allows_non_finite(type_name: str, path: str) -> bool:
    """Return whether NaN or an infinity in a field means that it has no value, such as "not measured" or "no echo"."""
    fields = _NON_FINITE.get(type_name)
    return fields is not None and re.fullmatch(fields, path) is not None
