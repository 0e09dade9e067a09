"""Cruises along a corridor, slower near places to avoid; a plan sets the parameters of a ROS node all at once."""

import os

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")

import rclpy
from rclpy.parameter import Parameter

WIDTH_M = 1.5


def node(publish, checked):
    rclpy.init()
    robot = rclpy.create_node("cruise", enable_rosout=False, start_parameter_services=False)
    robot.declare_parameters("", [("avoid", [4.0, 9.0]), ("speed", 0.5), ("lane", 0.0)])

    def plan(m):
        places = [float(place) for place in m["avoid"]]
        change = [Parameter(name, value=float(m[name])) for name in ("speed", "lane")]
        if checked:
            change.append(Parameter("avoid", Parameter.Type.DOUBLE_ARRAY, places))
        else:
            change.append(Parameter("avoid", value=places))
        if robot.set_parameters_atomically(change).successful:
            publish("agreed", {"id": m["id"], "places": len(places), "speed": robot.get_parameter("speed").value})

    def pose(m):
        speed = robot.get_parameter("speed").value
        near = any(abs(place - m["x"]) < WIDTH_M for place in robot.get_parameter("avoid").value)
        lane = robot.get_parameter("lane").value
        publish("cruise", {"speed": speed / 3 if near else speed, "turn": 0.4 * (lane - m["y"]) - 0.8 * m["yaw"]})

    return {"plan": plan, "pose": pose}
