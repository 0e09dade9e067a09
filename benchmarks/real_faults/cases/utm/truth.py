"""Fails at a longitude of 180 degrees, or so little less that adding 180 gives 360, wherever there are zones."""

import math

from changes import changed, drawn, near


def nominal():
    for i in range(60):
        yield i * 0.1, "fix", {"lat": 52.0 + 0.01 * i, "lon": 13.0 + math.sin(i / 9), "alt": 40.0 + i % 7}


def fails(log):
    for index, (_, _, m) in enumerate(log):
        if m["lon"] <= 180 and m["lon"] + 180 == 360 and -80 <= m["lat"] <= 84:
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "fix", lon=180.0)
    yield True, changed(log, "fix", 30, lon=180.0, lat=-80.0)
    yield True, changed(log, "fix", lon=math.nextafter(180.0, 0))
    yield False, changed(log, "fix", lon=179.9999999999999)
    yield False, changed(log, "fix", lon=-180.0)
    yield False, changed(log, "fix", lon=180.0, lat=84.1)


def draw(source):
    return drawn(
        source,
        list(nominal()),
        "fix",
        lat=lambda: near(source, -80.0, 84.0, 0.0),
        lon=lambda: near(source, 180.0, -180.0),
        alt=lambda: near(source, 0.0, 1e4),
    )
