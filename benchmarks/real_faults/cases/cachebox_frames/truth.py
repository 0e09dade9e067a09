"""Fails when something is seen from a frame that is, by way of its parents, in itself; the last parents count."""

import math

from changes import changed, drawn, near, nth, without

NAMES = ("map", "odom", "base", "trolley", "mast", "camera", "lidar", "dock")
TREE = (("odom", "map"), ("base", "odom"), ("mast", "base"), ("camera", "mast"), ("lidar", "base"), ("dock", "map"))


def nominal():
    """Carries a trolley, sets it down, rides on it, leaves it, and carries it again."""

    def frame(name, parent, i):
        inputs.append(("frame", {"name": name, "parent": parent, "x": 0.1 * i % 7, "y": 0.3, "yaw": math.sin(i / 9)}))

    inputs = []
    for i, (name, parent) in enumerate(TREE):
        frame(name, parent, i)
    for i in range(24):
        if i % 8 in (0, 3):
            frame("trolley", "map" if i % 8 else "base", i)
        frame("base", "trolley" if i % 8 in (4, 5, 6) else "odom", i)
        if i % 4 == 2:
            frame("mast", "base", i)
        view = ("camera", "lidar", "trolley")[i % 3]
        inputs.append(
            ("seen", {"id": 100 + i % 5, "frame": view, "range": 2 + 0.1 * (i % 6), "bearing": 0.2 - 0.02 * i})
        )
    for i, (topic, fields) in enumerate(inputs):
        yield i * 0.1, topic, fields


def fails(log):
    parents = {}
    for index, (_, topic, m) in enumerate(log):
        if topic == "frame":
            if all(abs(m[each]) < 1e6 for each in ("x", "y", "yaw")):
                parents[m["name"]] = m["parent"]
            continue
        name, steps = m["frame"], 0
        while name != "map" and name in parents and steps <= len(parents):
            name, steps = parents[name], steps + 1
        if steps > len(parents):
            return index


def edges():
    log = list(nominal())
    sets_down = next(i for i, each in enumerate(log) if each[2].get("name") == "trolley" and each[2]["parent"] == "map")
    number = sum(each[1] == "frame" for each in log[:sets_down])
    assert nth(log, "frame", number) == sets_down
    yield True, without(log, "frame", number)
    yield True, changed(log, "frame", number, x=math.nan)
    yield True, changed(log, "frame", number, yaw=1e6)
    yield False, changed(log, "frame", number, yaw=math.nextafter(1e6, 0))
    yield False, without(log, "frame", number, 5)
    yield True, changed(log, "frame", 2, parent="mast")
    yield False, changed(log, "frame", 2, parent="mast")[:8]
    yield False, changed(log, "frame", 5, parent="dock")
    yield False, changed(log, "frame", 4, parent="nowhere")
    yield True, changed(changed(log, "frame", 5, parent="dock"), "seen", 0, frame="dock")
    yield False, changed(log, "frame", 0, name="map", parent="map")
    yield False, changed(log, "frame", 1, parent="map")


def draw(source):
    log = list(nominal())
    if source.random() < 0.4:
        log = without(log, "frame", source.randrange(len(log)), source.choice([1, 1, 2, 4]))
    if source.random() < 0.3:
        first, other = source.sample(range(len(log)), 2)
        log[first], log[other] = log[other], log[first]
    if source.random() < 0.7:
        log = drawn(
            source,
            log,
            "frame",
            3,
            parent=lambda: source.choice(NAMES),
            name=lambda: source.choice(NAMES),
            x=lambda: near(source, 1e6, -1e6, 0.0),
        )
    return drawn(source, log, "seen", 3, frame=lambda: source.choice(NAMES), range=lambda: near(source, 0.0, 1e9))
