"""A control: there is no fault to trigger."""

import math


def nominal():
    for i in range(110):
        if i % 22 == 0:
            corners = 5 + i // 22
            turns = [2 * math.pi * corner / corners for corner in range(corners)]
            points = [[(40 + i // 4) * math.cos(each), 60 * math.sin(each)] for each in turns]
            yield i * 0.1, "fence", {"points": points, "name": f"field {i // 22}"}
        else:
            x, y = 0.6 * i * math.cos(i / 10), 45 * math.sin(i / 8)
            yield i * 0.1, "pose", {"x": x, "y": y, "yaw": math.remainder(i / 10, 2 * math.pi), "speed": 4.0 + i % 3}
