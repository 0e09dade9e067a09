"""Drives wheels from a timer of a ROS node; a scan that shows something near stops the timer until the way is free."""

import os
import random
import time
from concurrent.futures import ThreadPoolExecutor

os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}

import rclpy.executors

PACED, PERIOD_S, NEAR_M = True, 0.017, 0.4


def node(publish, checked):
    rclpy.init()
    robot = rclpy.create_node("wheels", enable_rosout=False)
    executor = rclpy.executors.MultiThreadedExecutor(2)
    last = {"nearest": 0.0, "bearing": 0.0}

    def drive():
        publish("wheels", {"speed": min(1.0, last["nearest"] / 3), "turn": -0.5 * last["bearing"]})

    timer = robot.create_timer(PERIOD_S, drive)
    spinning = ThreadPoolExecutor(1).submit(rclpy.spin, robot, executor)

    def look(m):
        time.sleep(random.uniform(0.009, 0.021))  # the scanner has to be told, on a slow line
        last.update(m)
        if m["nearest"] < NEAR_M:
            timer.cancel()
        elif timer.is_canceled():
            timer.reset()

    def scan(m):
        if spinning.done():
            spinning.result()
        executor.create_task(look, m)

    return {"scan": scan}
