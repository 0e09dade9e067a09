"""Tells from the voltage how full the battery is."""

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64

EMPTY, FULL = 9.6, 12.6


class Estimator(Node):
    def __init__(self):
        super().__init__("estimator")
        self.states = self.create_publisher(BatteryState, "/battery_state", 100)
        self.create_subscription(Float64, "/battery_voltage", self.on_voltage, 100)

    def on_voltage(self, voltage):
        state = BatteryState(voltage=voltage.data, present=True, current=-0.8, design_capacity=5.2)
        state.header.stamp = self.get_clock().now().to_msg()
        state.percentage = (voltage.data - EMPTY) / (FULL - EMPTY)
        state.cell_voltage = [voltage.data / 3] * 3
        self.states.publish(state)


rclpy.init()
rclpy.spin(Estimator())
