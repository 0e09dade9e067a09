"""Fails at a pose for which some of the tracks so far are wholly out of the window, and some are not."""

import math

from changes import changed, drawn, near, nth, without

HALF = 20.0


def nominal():
    """Drives east; three others stay within some metres, each in its lane."""
    for i in range(30):
        t, x = i * 0.2, 500.0 + 2.5 * i
        for k in range(3):
            if (i + k) % 3 == 0 or i == 0:
                place = {"x": x + 5 * k - 8 + 2 * math.sin(i / 5 + k), "y": 40 + 3.5 * k}
                yield t + 0.01 * k, "track", {"id": 11 + k, **place, "ahead": 4.0 + k + 0.1 * (i % 7)}
        yield t + 0.1, "pose", {"x": x, "y": 42.0 + 0.3 * math.sin(i / 8), "heading": 0.01 * math.sin(i)}


def ordinary(m):
    return abs(m["x"]) < 1e6 and abs(m["y"]) < 1e6


def fails(log):
    tracks = {}
    for index, (_, topic, m) in enumerate(log):
        if topic == "track":
            if ordinary(m) and 1 <= m["ahead"] <= 60:
                tracks[m["id"]] = (m["x"], m["x"] + m["ahead"], m["y"])
        elif ordinary(m):
            inside = [
                first <= m["x"] + HALF and last >= m["x"] - HALF and m["y"] - HALF <= y <= m["y"] + HALF
                for first, last, y in tracks.values()
            ]
            if any(inside) and not all(inside):
                return index


def edges():
    log = list(nominal())
    last = log[nth(log, "pose")][2]
    east, north, ahead = last["x"] + HALF, last["y"] + HALF, log[nth(log, "track")][2]["ahead"]
    yield False, changed(log, "track", x=east)
    yield True, changed(log, "track", x=math.nextafter(east, 1e9))
    yield False, changed(log, "track", x=east - 60, ahead=20.0)
    yield True, changed(log, "track", x=east - 60, ahead=math.nextafter(20.0, 0) - 1e-9)
    yield False, changed(log, "track", y=north)
    yield True, changed(log, "track", y=math.nextafter(north, 1e9))
    yield False, changed(log, "track", y=math.nan)
    yield False, changed(log, "track", x=1e6, ahead=ahead)
    yield True, changed(log, "track", x=-999999.0)
    yield True, changed(log, "track", 1, id=99)
    yield False, changed(log, "track", id=99)
    yield False, changed(log, "pose", x=0.0)
    yield False, changed(log, "pose", 4, x=math.inf)
    yield True, changed(log, "pose", 4, y=60.5)
    yield False, without(log, "track", 10, 2)
    yield True, without(log, "track", 12, 18)


def draw(source):
    log = list(nominal())
    if source.random() < 0.3:
        log = without(log, "track", source.randrange(30), source.choice([1, 3, 6, 9, 15]))
    if source.random() < 0.4:
        log = drawn(source, log, "pose", 2, x=lambda: near(source, 540.0, 1e6), y=lambda: near(source, 22.0, 62.0))
    x, y = lambda: near(source, 540.0, 580.0, -1e6), lambda: near(source, 20.0, 65.0)
    return drawn(
        source, log, "track", 2, x=x, y=y, ahead=lambda: near(source, 1.0, 60.0), id=lambda: 11 + source.randrange(4)
    )
