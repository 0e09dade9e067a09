"""A sound message of each type that the dictionaries know how to contradict."""

from __future__ import annotations

import importlib
from functools import cache
from pathlib import Path
from typing import Any

from riot_bus.types.model import MessageType
from riot_bus_mavlink.adapter import MavlinkAdapter
from riot_bus_mavlink.frame import pack_frame
from riot_bus_ros2.adapter import Ros2Adapter
from tests.rosbags_codec import encoded

ROVER = Path(__file__).resolve().parents[3] / "examples" / "rover"
ADAPTER = Ros2Adapter()
MAVLINK = MavlinkAdapter()
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
MAVLINK_SOUND: dict[str, dict[str, Any]] = {
    "ATTITUDE": {"roll": 0.25, "pitch": 0.5, "yaw": 1.0},
    "ATTITUDE_QUATERNION": {"q1": 1.0},
    "BATTERY_STATUS": {
        "id": 1, "battery_remaining": 50, "current_battery": 100, "current_consumed": 7, "energy_consumed": 8,
        "voltages[0]": 4000,
    },
    "CAMERA_INFORMATION": {
        "resolution_h": 640, "resolution_v": 480, "sensor_size_h": 5.0, "sensor_size_v": 4.0, "focal_length": 3.0,
    },
    "CAN_FRAME": {"len": 4, "id": 5},
    "COMMAND_ACK": {"command": 400},
    "COMMAND_INT": {"command": 192, "frame": 5, "x": 480000000, "y": 110000000, "param1": 1.0},
    "COMMAND_LONG": {"command": 400, "param1": 1.0, "confirmation": 1},
    "DATA_TRANSMISSION_HANDSHAKE": {"size": 1000, "packets": 5, "payload": 200, "width": 9, "height": 9},
    "DISTANCE_SENSOR": {"min_distance": 20, "max_distance": 900, "current_distance": 300},
    "ENCAPSULATED_DATA": {"seqnr": 1},
    "FILE_TRANSFER_PROTOCOL": {"payload[3]": 4, "payload[4]": 3, "payload[12]": 97},
    "GLOBAL_POSITION_INT": {"lat": 480000000, "lon": 110000000},
    "GPS2_RAW": {"fix_type": 3, "satellites_visible": 9, "lat": 480000000, "lon": 110000000, "alt": 5},
    "GPS_INJECT_DATA": {"len": 9},
    "GPS_RAW_INT": {"fix_type": 3, "satellites_visible": 9, "lat": 480000000, "lon": 110000000, "alt": 5},
    "GPS_RTCM_DATA": {"len": 9},
    "GPS_STATUS": {"satellites_visible": 9},
    "HEARTBEAT": {"type": 2, "autopilot": 3, "base_mode": 81, "custom_mode": 4, "system_status": 4},
    "LOGGING_DATA": {"length": 100, "first_message_offset": 3},
    "LOGGING_DATA_ACKED": {"length": 100, "first_message_offset": 3},
    "LOG_DATA": {"count": 90, "ofs": 90, "id": 1},
    "LOG_ENTRY": {"id": 2, "num_logs": 3, "last_log_num": 3, "size": 4000},
    "MISSION_ACK": {"type": 0},
    "MISSION_COUNT": {"count": 4},
    "MISSION_CURRENT": {"seq": 2, "total": 5},
    "MISSION_ITEM": {"seq": 2, "frame": 3, "command": 16, "x": 48.0, "y": 11.0},
    "MISSION_ITEM_INT": {"seq": 2, "frame": 6, "command": 16, "x": 480000000, "y": 110000000},
    "MISSION_ITEM_REACHED": {"seq": 2},
    "MISSION_REQUEST": {"seq": 2},
    "MISSION_REQUEST_INT": {"seq": 2},
    "MISSION_REQUEST_PARTIAL_LIST": {"start_index": 1, "end_index": 3},
    "MISSION_WRITE_PARTIAL_LIST": {"start_index": 1, "end_index": 3},
    "OBSTACLE_DISTANCE": {
        "min_distance": 20, "max_distance": 900, "increment": 5, "increment_f": 5.0, "distances[0]": 7,
    },
    "ODOMETRY": {"q[0]": 1.0, "frame_id": 20, "child_frame_id": 12, "pose_covariance[0]": 0.5},
    "PARAM_SET": {"param_id": "RATE", "param_value": 1.5, "param_type": 9},
    "PARAM_VALUE": {"param_id": "RATE", "param_value": 1.5, "param_type": 9, "param_count": 9, "param_index": 3},
    "POSITION_TARGET_LOCAL_NED": {"coordinate_frame": 1, "type_mask": 3000},
    "RC_CHANNELS": {"chancount": 8, "chan1_raw": 1500, "chan2_raw": 1500},
    "SERIAL_CONTROL": {"count": 9},
    "SET_POSITION_TARGET_LOCAL_NED": {"coordinate_frame": 1, "type_mask": 3000},
    "STATUSTEXT": {"severity": 6, "text": "ready"},
    "SYS_STATUS": {
        "onboard_control_sensors_present": 7, "onboard_control_sensors_health": 7, "voltage_battery": 12000,
        "current_battery": 50, "battery_remaining": 80, "load": 300,
    },
    "TRAJECTORY_REPRESENTATION_WAYPOINTS": {"valid_points": 2},
    "TUNNEL": {"payload_length": 9},
    "VIDEO_STREAM_INFORMATION": {"stream_id": 1, "count": 2},
}  # fmt: skip
for _name in (
    "ATTITUDE_QUATERNION_COV",
    "ATTITUDE_TARGET",
    "ATT_POS_MOCAP",
    "GIMBAL_DEVICE_ATTITUDE_STATUS",
    "GIMBAL_DEVICE_SET_ATTITUDE",
    "GIMBAL_MANAGER_SET_ATTITUDE",
    "HOME_POSITION",
    "SET_ATTITUDE_TARGET",
):
    MAVLINK_SOUND[_name] = {"q[0]": 1.0}
SOUND |= {f"mavlink/{name}": values for name, values in MAVLINK_SOUND.items()}
for _name in ("Byte", "Float32", "Float64", "Int8", "Int16", "Int32", "Int64", "UInt8", "UInt16", "UInt32", "UInt64"):
    SOUND[f"std_msgs/msg/{_name}MultiArray"] = ARRAY


def type_named(name: str) -> MessageType:
    kind = MAVLINK.type_named(name) or ADAPTER.type_named(name)
    assert kind is not None, name
    return kind


def blank(name: str) -> bytes:
    """Return a message whose numbers are zero, whose sequences are empty and whose texts are not."""
    kind = type_named(name)
    message = MAVLINK.dialect.message(name.removeprefix("mavlink/"))
    if message is not None:
        who = {"version": 2, "sequence": 1, "system": 1, "component": 1}
        return pack_frame(message.id, bytes(message.size), message.crc_extra, **who)
    zeros = b"\0\1\0\0" + bytes(4096)
    return kind.rebuild(zeros, {leaf.path: "s" for leaf in kind.leaves(zeros, elements=100) if leaf.type == "string"})


@cache
def sound(name: str) -> bytes:
    """Return a sound message, as rosbags encodes it, or a frame of MAVLink."""
    payload = type_named(name).rebuild(blank(name), SOUND[name])
    if name.startswith("mavlink/"):
        return payload
    return encoded(ADAPTER.store.decode(payload, name), name, ADAPTER.store)


def accept(name: str, payload: bytes) -> None:
    """Decode a message as others do; raises if they would not."""
    if name.startswith("mavlink/"):
        module = importlib.import_module("pymavlink.dialects.v20.all")
        module.MAVLink(None).decode(bytearray(payload))
    else:
        ADAPTER.store.decode(payload, name)
