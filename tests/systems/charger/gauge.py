"""The outside world: a battery of about 11.4 V, and somebody who waits until the lamp is on before the test begins."""

import random
import sys
import time

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Float64, String

SECONDS, SEED = float(sys.argv[1]), int(sys.argv[2])
RATE = 100.0
PATIENCE = 10.0


class Gauge(Node):
    def __init__(self):
        super().__init__("gauge")
        self.noise = random.Random(SEED)
        self.seen = False
        self.voltages = self.create_publisher(Float64, "/battery_voltage", 100)
        self.create_subscription(String, "/lamp_colour", self.on_colour, 1)

    def on_colour(self, _):
        self.seen = True

    def measure(self, wait):
        self.voltages.publish(Float64(data=11.4 + self.noise.uniform(-0.6, 0.6)))
        rclpy.spin_once(self, timeout_sec=max(0.0, wait))


rclpy.init()
gauge = Gauge()
deadline = time.monotonic() + PATIENCE
while not gauge.seen and time.monotonic() < deadline:
    gauge.measure(0.1)
start = time.monotonic()
for tick in range(int(SECONDS * RATE)):
    time.sleep(max(0.0, start + tick / RATE - time.monotonic()))
    gauge.measure(0.0)
gauge.voltages.wait_for_all_acked(Duration(seconds=PATIENCE))
