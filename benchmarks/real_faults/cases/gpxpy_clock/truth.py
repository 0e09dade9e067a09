"""Fails at a fix at another place and less than a second after the one before, once the vehicle has moved."""

import datetime
import math

from changes import changed, drawn, near

BEGIN = 1_700_000_000.0


def nominal():
    for i in range(90):
        stamp = BEGIN + i * 1.25 + 0.01 * (i * 7 % 5)
        lat, lon = 48.1 + 1.2e-5 * i, 11.5 + 9e-6 * i + 4e-5 * math.sin(i / 11)
        yield i * 0.125, "fix", {"stamp": stamp, "lat": lat, "lon": lon, "alt": 520.0 + i % 6, "quality": 4 + i % 2}


def metres(a, b):
    """Return the distance of two fixes; only whether it is nought, and roughly how much, matters."""
    north, east = a["lat"] - b["lat"], (a["lon"] - b["lon"]) * math.cos(math.radians(a["lat"]))
    up = a["alt"] - b["alt"] if a["alt"] and b["alt"] else 0.0
    return math.hypot(math.sqrt(north * north + east * east) * 111_000, up)


def fails(log):
    last, moved = None, False
    for index, (_, _, m) in enumerate(log):
        place = m["quality"] > 0 and -90 <= m["lat"] <= 90 and -180 <= m["lon"] <= 180 and -500 <= m["alt"] <= 9000
        if not (place and 0 <= m["stamp"] < 4e9):
            continue
        time = datetime.datetime.fromtimestamp(m["stamp"], datetime.UTC)
        if last is not None:
            seconds, way = (time - last[0]) // datetime.timedelta(seconds=1), metres(m, last[1])
            if seconds == 0 and way and moved:
                return index
            moved = moved or (seconds > 0 and way / seconds > 1 / 3.6)
        last = time, m
    return None


def edges():
    log = list(nominal())
    stamps = [m["stamp"] for _, _, m in log]
    yield True, changed(log, "fix", 40, stamp=stamps[39])
    yield True, changed(log, "fix", 40, stamp=stamps[41])
    yield True, changed(log, "fix", 2, stamp=stamps[1] + 0.5)
    yield True, changed(log, "fix", 40, stamp=stamps[39] + 0.999999)
    yield True, changed(changed(log, "fix", 40, stamp=stamps[38]), "fix", 39, stamp=stamps[38])
    yield False, changed(log, "fix", 1, stamp=stamps[0])
    yield False, changed(log, "fix", 40, stamp=stamps[39] + 1.000001)
    yield False, changed(log, "fix", 40, stamp=stamps[39] - 2e-6)
    yield False, changed(log, "fix", 40, stamp=stamps[30])
    yield False, changed(log, "fix", 40, stamp=stamps[39], quality=0)
    yield False, changed(log, "fix", 40, stamp=stamps[39], lat=log[39][2]["lat"], lon=log[39][2]["lon"], alt=0.0)
    yield False, [*log[:40], log[39], *log[40:]]


def draw(source):
    log = list(nominal())
    index = source.randrange(1, 89)
    if source.random() < 0.6:
        return changed(log, "fix", index, stamp=log[index][2]["stamp"] + source.choice([-2, -1, 1]) * source.random())
    stamp = log[index - 1][2]["stamp"]
    return drawn(
        source,
        log,
        "fix",
        3,
        stamp=lambda: source.choice([stamp, near(source, stamp), 0.0, math.nan]),
        quality=lambda: source.randint(-1, 3),
        lat=lambda: near(source, 48.1, 90.0, -90.0),
        lon=lambda: near(source, 11.5, 180.0),
        alt=lambda: near(source, 0.0, 520.0, 9000.0),
    )
