"""The unit: shows how full the battery is, and has a colour for each tenth but none for more than full."""

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String

COLOURS = ("black", "red", "red", "orange", "orange", "yellow", "yellow", "green", "green", "blue", "white")


class Lamp(Node):
    def __init__(self):
        super().__init__("lamp")
        self.colours = self.create_publisher(String, "/lamp_colour", 100)
        self.create_subscription(BatteryState, "/battery_state", self.on_state, 100)

    def on_state(self, state):
        if state.present:
            self.colours.publish(String(data=COLOURS[int(max(0.0, 10 * state.percentage))]))


rclpy.init()
rclpy.spin(Lamp())
