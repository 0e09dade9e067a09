"""Tells roll, pitch and yaw of every fifth sample of an IMU, averaged over five, and the smoothed turn rate."""

import collections
import math

from scipy import signal
from scipy.spatial.transform import Rotation

LOW = signal.butter(2, 0.2, output="sos")


def node(publish, checked):
    recent = collections.deque(maxlen=5)
    count, inner = 0, [[0.0, 0.0]]

    def imu(m):
        nonlocal count, inner
        q, rates = m["q"], m["gyro"]
        if len(q) != 4 or len(rates) != 3 or not all(abs(each) <= 35 for each in rates):
            return
        if not (all(abs(each) <= 1.01 for each in q) and abs(math.hypot(*q) - 1) <= 0.01):
            return
        recent.append(q)
        rate, inner = signal.sosfilt(LOW, [float(rates[2])], zi=inner)
        count += 1
        if count % 5:
            return
        mean = Rotation.from_quat(list(recent)).mean()
        yaw, pitch, roll = mean.as_euler("ZYX", degrees=True).tolist()
        tilt = math.degrees(math.acos(max(-1.0, min(1.0, float(mean.apply([0, 0, 1])[2])))))
        publish("attitude", {"roll": roll, "pitch": pitch, "yaw": yaw, "tilt": tilt, "rate": float(rate[0])})

    return {"imu": imu}
