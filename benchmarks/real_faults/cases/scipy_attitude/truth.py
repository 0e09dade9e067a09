"""A control: there is no fault to trigger."""

import math


def nominal():
    for i in range(120):
        half = 0.3 * math.sin(i / 15)
        roll = 0.05 * math.cos(i / 6)
        q = [
            math.sin(roll) * math.cos(half),
            math.sin(roll) * math.sin(half),
            math.cos(roll) * math.sin(half),
            math.cos(roll) * math.cos(half),
        ]
        yield i * 0.05, "imu", {"q": q, "gyro": [0.02 * (i % 3), -0.01, 0.1 * math.cos(i / 15)], "temp": 36.5 + i % 2}
