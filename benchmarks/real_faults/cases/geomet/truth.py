"""Fails as soon as a line of four fixes has a number that is between 0 and 0.0001 when rounded to five digits."""

import math

from changes import changed, drawn, near, without


def nominal():
    for i in range(72):
        lat, lon = 51.4779 + 0.002 * math.sin(i / 8), 0.0021 + 0.0002 * i
        fields = {"lat": lat, "lon": lon, "alt": 46.5 + 0.3 * (i % 5), "satellites": 7 + i % 4, "quality": 1 + i % 2}
        yield i * 0.2, "fix", fields


def small(number):
    return 0 < abs(round(float(number), 5)) < 0.0001


def fails(log):
    last = []
    for index, (_, _, m) in enumerate(log):
        if m["quality"] == 0 or not (abs(m["lat"]) <= 90 and abs(m["lon"]) <= 180 and -500 <= m["alt"] <= 9000):
            continue
        last = [*last[-3:], small(m["lat"]) or small(m["lon"]) or small(m["alt"])]
        if len(last) == 4 and any(last):
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "fix", 30, lon=9.4e-5)
    yield False, changed(log, "fix", 30, lon=9.6e-5)
    yield True, changed(log, "fix", 30, lon=-5.1e-6)
    yield False, changed(log, "fix", 30, lon=-4.9e-6)
    yield True, changed(log, "fix", lat=0.00001)
    yield True, changed(log, "fix", 0, alt=0.00002)
    yield False, changed(log, "fix", lat=0.00001, lon=180.1)
    yield False, changed(log, "fix", 3, lat=0.00001, quality=0)
    yield False, changed(without(log, "fix", 3, 99), "fix", lon=0.00001)
    yield False, changed(log, "fix", 40, lat=0.0, lon=-0.0, alt=5e-324)


def draw(source):
    def number():
        tiny = source.choice([-1, 1]) * 10 ** source.uniform(-6.5, -2.5)
        return source.choice(
            [tiny, tiny, near(source, 5e-6, 1e-5, 9.5e-5, 1e-4) * 1e-5, near(source, -90.0, 0.0, 180.0)]
        )

    log = drawn(source, list(nominal()), "fix", lat=number, lon=number, alt=number)
    return drawn(
        source, log, "fix", quality=lambda: source.choice([0, 1, 2]), satellites=lambda: source.randint(-1, 99)
    )
