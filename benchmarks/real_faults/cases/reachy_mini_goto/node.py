"""Turns the head of a Reachy Mini from where it is to where it is told, as its Zenoh server does, in 8 steps."""

import numpy as np
from reachy_mini.io.protocol import GotoTaskRequest
from reachy_mini.motion.goto import GotoMove
from reachy_mini.utils import create_head_pose
from scipy.spatial.transform import Rotation

STEPS, METHODS = 8, ("linear", "minjerk", "ease_in_out")  # the fourth one overshoots


def node(publish, checked):
    now = {"yaw": 0.0, "z": 0.0, "antennas": [0.0, 0.0]}

    def move(yaw, z, antennas, duration, method):
        head = create_head_pose(yaw=yaw, z=z, mm=True).flatten().tolist()
        request = GotoTaskRequest(head=head, antennas=antennas, duration=duration, method=method, body_yaw=None)
        start, end = create_head_pose(yaw=now["yaw"], z=now["z"], mm=True), np.array(request.head).reshape(4, 4)
        antennas_now = np.array(now["antennas"])
        goto = GotoMove(start, end, antennas_now, np.array(antennas), 0.0, None, request.duration, request.method)
        now.update(yaw=yaw, z=z, antennas=antennas)
        for step in range(STEPS + 1):
            pose, ears, _ = goto.evaluate(goto.duration * step / STEPS)
            turn = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)[2]
            publish("head", {"yaw": float(turn), "z": float(pose[2, 3]), "left": float(ears[0]), "part": step / STEPS})

    def goto(m):
        if not (abs(m["yaw"]) <= 150 and abs(m["z"]) <= 25 and 0 < m["duration"] <= 10 and m["method"] in METHODS):
            return
        ears = [m["left"], m["right"]]
        if checked and abs(m["yaw"] - now["yaw"]) > 180:
            middle = (m["yaw"] + now["yaw"]) / 2
            move(middle, m["z"], ears, m["duration"] / 2, m["method"])
        move(m["yaw"], m["z"], ears, m["duration"], m["method"])

    return {"goto": goto}
