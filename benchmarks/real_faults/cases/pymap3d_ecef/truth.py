"""Fails at a solution more than 5 cm below the ellipsoid, whose altitude is then wrong by twice that."""

import math

from changes import changed, near

MAJOR, MINOR = 6378137.0, 6356752.31424518
ECCENTRIC = 1 - (MINOR / MAJOR) ** 2
LIMIT = 0.05


def place(lat, lon, alt):
    lat, lon = math.radians(lat), math.radians(lon)
    bend = MAJOR / math.sqrt(1 - ECCENTRIC * math.sin(lat) ** 2)
    flat = (bend + alt) * math.cos(lat)
    x, y = flat * math.cos(lon), flat * math.sin(lon)
    return {"x": x, "y": y, "z": (bend * (1 - ECCENTRIC) + alt) * math.sin(lat)}


def altitude(x, y, z):
    """By Bowring's angle, three times."""
    flat = math.hypot(x, y)
    tilt = math.atan2(z * MAJOR, flat * MINOR)
    for _ in range(3):
        over = z + (MAJOR**2 / MINOR**2 - 1) * MINOR * math.sin(tilt) ** 3
        lat = math.atan2(over, flat - ECCENTRIC * MAJOR * math.cos(tilt) ** 3)
        tilt = math.atan2(MINOR * math.sin(lat), MAJOR * math.cos(lat))
    return (flat - MAJOR * math.cos(tilt)) * math.cos(lat) + (z - MINOR * math.sin(tilt)) * math.sin(lat)


def nominal():
    for i in range(80):
        where = place(32.81 + 2e-5 * i, 35.03 + 1e-5 * i, 42.0 - 0.2 * i + 4 * math.sin(i / 7))
        yield i * 0.1, "solution", where | {"satellites": 9 + i % 4, "pdop": 1.4 + i % 3 / 10, "age": 0.02}


def fails(log):
    for index, (_, _, m) in enumerate(log):
        x, y, z = m["x"], m["y"], m["z"]
        inside = not m["satellites"] < 4 and 6.25e6 < math.hypot(x, y, z) < 6.45e6
        if inside and altitude(x, y, z) < -LIMIT:
            return index


def edges():
    log = list(nominal())
    for lat, lon in ((32.8, 35.0), (0.0, 0.0), (-45.0, 179.9), (89.999, 10.0)):
        yield True, changed(log, "solution", **place(lat, lon, -LIMIT - 0.001))
        yield False, changed(log, "solution", **place(lat, lon, -LIMIT + 0.001))
    yield True, changed(log, "solution", 9, **place(31.5, 35.5, -430.0))
    yield True, changed(log, "solution", x=log[-1][2]["x"] - 100)
    yield False, changed(log, "solution", x=log[-1][2]["x"] + 100, pdop=0.0, age=1e9)
    yield False, changed(log, "solution", 9, **place(31.5, 35.5, -430.0), satellites=3)
    yield False, changed(log, "solution", x=0.0, y=0.0, z=0.0)


def draw(source):
    log, number = list(nominal()), source.randrange(80)
    if source.random() < 0.5:
        alt = source.choice([near(source, 0.0), source.uniform(-0.2, 0.1), source.uniform(-2000, 2000)])
        return changed(log, "solution", number, **place(source.uniform(-89, 89), source.uniform(-180, 180), alt))
    name = source.choice(["x", "y", "z"])
    return changed(log, "solution", number, **{name: log[number][2][name] + source.uniform(-300, 300)})


def shows(log, outputs):
    return any(abs(m["error"]) > 2 * LIMIT for _, m in outputs)
