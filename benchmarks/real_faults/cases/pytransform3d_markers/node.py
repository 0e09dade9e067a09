"""Places markers in the frame of the vehicle while its camera sees them."""

import math

import numpy as np
from pytransform3d import rotations, transformations
from pytransform3d.transform_manager import TransformManager

MOUNT = transformations.transform_from(rotations.active_matrix_from_angle(1, 0.2), np.array([0.3, 0.0, 1.1]))


def node(publish, checked):
    frames = TransformManager()
    frames.add_transform("camera", "vehicle", MOUNT)

    def seen(m):
        if not all(math.isfinite(m[key]) for key in ("x", "y", "yaw")):
            return
        turned = rotations.active_matrix_from_angle(2, m["yaw"])
        frames.add_transform(m["marker"], "camera", transformations.transform_from(turned, [m["x"], m["y"], 0.0]))
        place = frames.get_transform(m["marker"], "vehicle")
        publish("place", {"marker": m["marker"], "x": place[0, 3], "y": place[1, 3], "z": place[2, 3]})

    def gone(m):
        frames.remove_transform(m["marker"], "camera")

    return {"seen": seen, "gone": gone}
