"""A sound message of each type that the dictionaries know how to contradict."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from riot_bus.types.model import MessageType
from riot_bus_ros2.adapter import Ros2Adapter

ROVER = Path(__file__).resolve().parents[3] / "examples" / "rover"
ADAPTER = Ros2Adapter()
ADAPTER.load([ROVER / "map_msgs/msg/OccupancyGridUpdate.msg"])

TURN = {"x": 0.5, "y": -0.5, "z": 0.5, "w": 0.5}
GOOD_COVARIANCE = {f"covariance[{7 * n}]": 0.25 for n in range(6)} | {"covariance[1]": 0.0625, "covariance[6]": 0.0625}
ARRAY = {"layout.dim[0].size": 6, "layout.dim[0].stride": 6, "len(layout.dim)": 1, "len(data)": 6}
SCAN = {
    "angle_min": -1.0,
    "angle_max": 1.0,
    "angle_increment": 0.5,
    "range_min": 0.125,
    "range_max": 8.0,
    "len(ranges)": 5,
}
JOINTS = {"len(joint_names)": 2, "joint_names[0]": "a", "joint_names[1]": "b", "len(points)": 2}
SOUND: dict[str, dict[str, Any]] = {
    "builtin_interfaces/msg/Time": {"sec": 1_700_000_000, "nanosec": 5},
    "builtin_interfaces/msg/Duration": {"sec": 3, "nanosec": 500_000_000},
    "diagnostic_msgs/msg/DiagnosticArray": {"len(status)": 2},
    "diagnostic_msgs/msg/DiagnosticStatus": {"level": 2, "len(values)": 2, "name": "motor"},
    "geometry_msgs/msg/AccelWithCovariance": GOOD_COVARIANCE,
    "geometry_msgs/msg/Inertia": {"m": 2.0, "ixx": 1.0, "iyy": 1.0, "izz": 1.5},
    "geometry_msgs/msg/Polygon": {"len(points)": 4, "points[1].x": 1.0, "points[2].y": 2.0},
    "geometry_msgs/msg/PoseArray": {"len(poses)": 3},
    "geometry_msgs/msg/PoseWithCovariance": GOOD_COVARIANCE | {f"pose.orientation.{k}": v for k, v in TURN.items()},
    "geometry_msgs/msg/Quaternion": TURN,
    "geometry_msgs/msg/TransformStamped": {"header.frame_id": "map", "child_frame_id": "base"},
    "geometry_msgs/msg/TwistWithCovariance": GOOD_COVARIANCE,
    "map_msgs/msg/OccupancyGridUpdate": {"x": 5, "y": 6, "width": 4, "height": 3, "len(data)": 12},
    "nav_msgs/msg/GridCells": {"cell_width": 0.5, "cell_height": 0.5, "len(cells)": 3},
    "nav_msgs/msg/MapMetaData": {"width": 4, "height": 3, "resolution": 0.5},
    "nav_msgs/msg/OccupancyGrid": {"info.width": 4, "info.height": 3, "info.resolution": 0.5, "len(data)": 12},
    "nav_msgs/msg/Path": {"len(poses)": 3, "poses[1].pose.position.x": 2.0},
    "sensor_msgs/msg/BatteryState": {
        "percentage": 0.5, "charge": 2.5, "capacity": 5.0, "voltage": 12.0, "current": -1.0, "design_capacity": 5.5,
        "present": True, "len(cell_voltage)": 3,
    },
    "sensor_msgs/msg/CameraInfo": {
        "width": 4, "height": 3, "len(d)": 5, "k[0]": 2.0, "k[4]": 2.0, "k[8]": 1.0, "p[0]": 2.0, "r[0]": 1.0,
        "distortion_model": "plumb_bob", "roi.width": 2, "roi.height": 2,
    },
    "sensor_msgs/msg/CompressedImage": {
        "format": "jpeg", "len(data)": 8, "data[0]": 0xFF, "data[1]": 0xD8, "data[2]": 0xFF,
    },
    "sensor_msgs/msg/FluidPressure": {"fluid_pressure": 101325.0, "variance": 1.0},
    "sensor_msgs/msg/Illuminance": {"illuminance": 300.0, "variance": 1.0},
    "sensor_msgs/msg/Image": {"width": 4, "height": 3, "step": 12, "len(data)": 36, "encoding": "rgb8"},
    "sensor_msgs/msg/Imu": {
        "linear_acceleration.z": 9.75, "orientation_covariance[0]": 0.5, "angular_velocity_covariance[0]": 0.5,
        "linear_acceleration_covariance[0]": 0.5,
    } | {f"orientation.{k}": v for k, v in TURN.items()},
    "sensor_msgs/msg/JointState": {
        "len(name)": 2, "name[0]": "left", "name[1]": "right", "len(position)": 2, "len(velocity)": 2,
        "position[0]": 1.0,
    },
    "sensor_msgs/msg/Joy": {"len(axes)": 2, "len(buttons)": 2, "axes[0]": 0.5},
    "sensor_msgs/msg/JoyFeedback": {"type": 1, "intensity": 0.5},
    "sensor_msgs/msg/LaserScan": SCAN | {
        "ranges[0]": 1.0, "ranges[4]": 2.0, "len(intensities)": 5, "time_increment": 0.125, "scan_time": 0.5,
    },
    "sensor_msgs/msg/MagneticField": {"magnetic_field.x": 1e-5, "magnetic_field_covariance[0]": 1e-12},
    "sensor_msgs/msg/MultiDOFJointState": {"len(joint_names)": 2, "len(transforms)": 2},
    "sensor_msgs/msg/MultiEchoLaserScan": SCAN,
    "sensor_msgs/msg/NavSatFix": {
        "latitude": 48.0, "longitude": 11.0, "altitude": 520.0, "position_covariance_type": 2,
        "position_covariance[0]": 1.0,
    },
    "sensor_msgs/msg/NavSatStatus": {"status": 1},
    "sensor_msgs/msg/PointCloud": {
        "len(points)": 3, "len(channels)": 1, "len(channels[0].values)": 3,
    },
    "sensor_msgs/msg/PointCloud2": {
        "width": 4, "height": 2, "point_step": 12, "row_step": 48, "len(data)": 96, "data[0]": 1, "len(fields)": 2,
        "fields[0].name": "x", "fields[0].datatype": 7, "fields[0].count": 1, "fields[1].name": "y",
    },
    "sensor_msgs/msg/Range": {"min_range": 0.125, "max_range": 4.0, "range": 2.0, "field_of_view": 0.25},
    "sensor_msgs/msg/RegionOfInterest": {"x_offset": 3, "y_offset": 2, "width": 4, "height": 3},
    "sensor_msgs/msg/RelativeHumidity": {"relative_humidity": 0.5, "variance": 0.5},
    "sensor_msgs/msg/Temperature": {"temperature": 21.5, "variance": 0.5},
    "shape_msgs/msg/Mesh": {
        "len(vertices)": 3, "len(triangles)": 1, "triangles[0].vertex_indices[1]": 1,
        "triangles[0].vertex_indices[2]": 2,
    },
    "shape_msgs/msg/Plane": {"coef[2]": 1.0},
    "shape_msgs/msg/SolidPrimitive": {"type": 1, "len(dimensions)": 3, "dimensions[0]": 0.5},
    "std_msgs/msg/ColorRGBA": {"r": 0.25, "g": 0.5, "b": 0.75, "a": 1.0},
    "stereo_msgs/msg/DisparityImage": {
        "f": 2.0, "t": 0.25, "max_disparity": 16.0, "image.width": 4, "image.height": 3, "valid_window.width": 4,
        "valid_window.height": 3,
    },
    "tf2_msgs/msg/TFMessage": {"len(transforms)": 2},
    "trajectory_msgs/msg/JointTrajectory": JOINTS | {
        "len(points[0].positions)": 2, "len(points[1].positions)": 2, "points[1].time_from_start.sec": 1,
    },
    "trajectory_msgs/msg/JointTrajectoryPoint": {"len(positions)": 2},
    "trajectory_msgs/msg/MultiDOFJointTrajectory": JOINTS | {
        "len(points[0].transforms)": 2, "points[1].time_from_start.sec": 1,
    },
    "visualization_msgs/msg/Marker": {
        "type": 4, "len(points)": 3, "len(colors)": 3, "scale.x": 1.0,
    },
    "visualization_msgs/msg/MarkerArray": {"len(markers)": 2},
}  # fmt: skip
for _name in ("Byte", "Float32", "Float64", "Int8", "Int16", "Int32", "Int64", "UInt8", "UInt16", "UInt32", "UInt64"):
    SOUND[f"std_msgs/msg/{_name}MultiArray"] = ARRAY


def type_named(name: str) -> MessageType:
    kind = ADAPTER.type_named(name)
    assert kind is not None, name
    return kind


def blank(name: str) -> bytes:
    """Return a message whose numbers are zero, whose sequences are empty and whose texts are not."""
    kind = type_named(name)
    zeros = b"\0\1\0\0" + bytes(4096)
    return kind.rebuild(zeros, {leaf.path: "s" for leaf in kind.leaves(zeros, elements=100) if leaf.type == "string"})


@cache
def sound(name: str) -> bytes:
    """Return a sound message, as rosbags encodes it."""
    payload = type_named(name).rebuild(blank(name), SOUND[name])
    return ADAPTER.store.encode(ADAPTER.store.decode(payload, name), name)
