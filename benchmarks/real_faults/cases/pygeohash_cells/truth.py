"""Fails at a longitude from which steps of 360 degrees take too long, or lead nowhere.

Between 1e11 and 1e14 it depends on the machine whether that still ends in seconds; the limit here is 2e12.
"""

import math

from changes import changed, drawn, near

LIMIT = 2e12


def nominal():
    for i in range(90):
        lat, lon = 47.37 + 0.0004 * (i % 12), 8.54 + 0.0004 * (i // 12)
        yield (
            i * 0.2,
            "fix",
            {"lat": lat, "lon": lon, "alt": 408 + i % 5, "quality": 1 + i % 2, "hdop": 0.8 + i % 4 / 10},
        )


def fails(log):
    for index, (_, _, m) in enumerate(log):
        if abs(m["lon"]) > LIMIT and not m["quality"] < 1 and not m["hdop"] > 5:
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "fix", lon=1e14)
    yield True, changed(log, "fix", 20, lon=-1e300)
    yield True, changed(log, "fix", 20, lon=math.inf, lat=math.nan)
    yield False, changed(log, "fix", lon=1e10)
    yield False, changed(log, "fix", lon=-1e10)
    yield False, changed(log, "fix", lon=math.nan)
    yield False, changed(log, "fix", lat=1e300, alt=1e300)
    yield False, changed(log, "fix", lon=1e300, quality=0)
    yield False, changed(log, "fix", lon=1e300, hdop=5.1)


def draw(source):
    return drawn(
        source,
        list(nominal()),
        "fix",
        2,
        lat=lambda: near(source, 90.0, -90.0, 0.0),
        lon=lambda: source.choice(
            [near(source, 180.0, -180.0), 1e9, *[source.choice([-1, 1]) * 1e15 ** source.uniform(1, 20)] * 4]
        ),
        quality=lambda: source.choice([0, 1, 5]),
    )
