"""Shows at a fix that is told and whose latitude or longitude is below zero."""

import math

from changes import changed, drawn, near

MODES = ("single", "dgps", "float", "fixed")


def nominal():
    for i in range(66):
        fields = {"lat": 47.3769 + 0.001 * math.cos(i / 6), "lon": 8.5417 + 0.0004 * i, "speed": 3 + i % 5 - i % 3}
        yield i * 0.5, "fix", {"clock": 43195.5 + i * 0.5, "mode": MODES[i * 7 // 11 % 4], **fields}


def told(m):
    inside = abs(m["lat"]) <= 90 and abs(m["lon"]) <= 180 and 0 <= m["clock"] < 86400
    return inside and m["mode"] in MODES


def fails(log):
    for index, (_, _, m) in enumerate(log):
        if told(m) and (m["lat"] < 0 or m["lon"] < 0):
            return index


def shows(log, outputs):
    for m, (_, fields) in zip((m for _, _, m in log if told(m)), outputs, strict=False):
        words = fields["line"].split(",")
        if (words[3], words[5]) != ("S" if m["lat"] < 0 else "N", "W" if m["lon"] < 0 else "E"):
            return True
    return False


def edges():
    log = list(nominal())
    yield True, changed(log, "fix", 20, lat=-33.85)
    yield True, changed(log, "fix", 21, lon=-5e-324)
    yield False, changed(log, "fix", 21, lon=-0.0, lat=0.0)
    yield True, changed(log, "fix", lat=-90, lon=180.0)
    yield False, changed(log, "fix", lat=-90.00000000000001)
    yield True, changed(log, "fix", lat=1, lon=-180)
    yield False, changed(log, "fix", lat=-10.0, mode="no fix")
    yield True, changed(log, "fix", lat=-10.0, clock=86399.9)
    yield False, changed(log, "fix", lat=-10.0, clock=86400)
    yield False, changed(log, "fix", speed=-3, lat=90.0, lon=180.0)


def draw(source):
    return drawn(
        source,
        list(nominal()),
        "fix",
        most=2,
        lat=lambda: near(source, 0.0, 0.0, -90.0, 90.0),
        lon=lambda: near(source, 0.0, 0.0, -180.0, 180.0),
        clock=lambda: near(source, 0.0, 86400.0, 43200.0),
        mode=lambda: source.choice([*MODES, ""]),
    )
