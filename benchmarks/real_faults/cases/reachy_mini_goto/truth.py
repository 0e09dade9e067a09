"""Fails at a goto that turns the head by more than 180 degrees from where the last one left it."""

import math

from changes import changed, drawn, near, without

METHODS = ("linear", "minjerk", "ease_in_out")


def nominal():
    for i in range(60):
        yield (
            i * 0.8,
            "goto",
            {
                "yaw": round(100 * math.sin(i / 4), 2),
                "z": round(8 * math.sin(i / 3), 1),
                "left": round(0.6 * math.cos(i / 4), 3),
                "right": round(-0.6 * math.cos(i / 5), 3),
                "duration": 0.5 + 0.05 * (i % 5),
                "method": METHODS[i // 9 % 3],
            },
        )


def fails(log):
    yaw = 0.0
    for index, (_, _, m) in enumerate(log):
        if not (abs(m["yaw"]) <= 150 and abs(m["z"]) <= 25 and 0 < m["duration"] <= 10 and m["method"] in METHODS):
            continue
        if abs(m["yaw"] - yaw) > 180:
            return index
        yaw = m["yaw"]


def shows(log, outputs):
    ways = []
    for _, m in outputs:
        ways += [[]] if not m["part"] else []
        ways[-1].append(m["yaw"])
    return any(not min(way[0], way[-1]) - 0.01 < yaw < max(way[0], way[-1]) + 0.01 for way in ways for yaw in way)


def edges():
    log = list(nominal())
    at = 6  # its yaw is 99.75
    yield True, changed(log, "goto", at + 1, yaw=-80.26)
    yield True, changed(log, "goto", at + 1, yaw=-150.0, method="linear")
    yield True, changed(changed(log, "goto", 40, yaw=140.0), "goto", 41, yaw=-120.0)
    yield True, without(log, "goto", at + 1, 11)
    yield False, changed(log, "goto", at + 1, yaw=-80.24)
    yield False, changed(log, "goto", at + 1, yaw=-150.01)
    yield False, changed(log, "goto", at + 1, yaw=-150.0, duration=0.0)
    yield False, changed(log, "goto", at + 1, yaw=-150.0, z=math.nan)
    yield False, changed(log, "goto", at + 1, yaw=-150.0, method="")
    yield False, without(log, "goto", at + 1, 9)


def draw(source):
    def yaw():
        return source.choice([near(source, 150.0, -150.0), source.uniform(-150, 150), source.uniform(-80, 80)])

    def other(limit):
        return lambda: near(source, limit, -limit) if source.random() < 0.1 else source.uniform(-limit, limit)

    log = drawn(source, list(nominal()), "goto", 2, yaw=yaw, z=other(25.0))
    return drawn(source, log, "goto", 3, left=other(1.5), duration=lambda: near(source, 0.5, 10.0))
