"""Fails at a scan of which not one beam has an echo within the scanner's range, in a direction that is a number."""

import math

from changes import changed, drawn, near

BEAMS = 24


def nominal():
    for i in range(80):
        ranges = [4.0 + 2.0 * math.sin(i / 11 + k / 3) + 0.02 * ((7 * i + 3 * k) % 5) for k in range(BEAMS)]
        ranges[(5 * i) % BEAMS] = 0.0  # no echo
        if i % 3 == 0:
            ranges[(7 * i + 2) % BEAMS] = 30.0
        limits = {"range_min": 0.15, "range_max": 12.0}
        yield i * 0.1, "scan", {"first": -1.5, "step": 0.125, **limits, "ranges": ranges, "celsius": 31 + 0.1 * (i % 9)}


def seen(m):
    return sum(
        max(m["range_min"], 0) <= each <= m["range_max"]
        and 0 <= each < 100
        and math.isfinite(m["first"] + m["step"] * k)
        for k, each in enumerate(m["ranges"])
        if not math.isnan(m["range_min"])
    )


def fails(log):
    for index, (_, _, m) in enumerate(log):
        if not seen(m):
            return index


def edges():
    log = list(nominal())
    closest = min(each for each in log[40][2]["ranges"] if each)
    farthest = max(each for each in log[40][2]["ranges"] if each < 12)
    yield True, changed(log, "scan", 40, range_max=math.nextafter(closest, 0))
    yield False, changed(log, "scan", 40, range_max=closest)
    yield True, changed(log, "scan", 40, range_min=math.nextafter(farthest, 9))
    yield False, changed(log, "scan", 40, range_min=farthest)
    for ranges in ([], [0.0] * BEAMS, [math.inf, math.nan, -1.0], [12.5, 0.1]):
        yield True, changed(log, "scan", 7, ranges=ranges)
    for ranges in ([12.0], [0.15, math.nan]):
        yield False, changed(log, "scan", 7, ranges=ranges)
    for fields in ({"range_max": math.nan}, {"range_min": math.nan}, {"first": math.inf}, {"step": -math.inf}):
        yield True, changed(log, "scan", **fields)
    yield False, changed(log, "scan", 0, range_max=math.inf, range_min=-math.inf)
    yield False, changed(log, "scan", 0, range_max=1e308, range_min=-1e308, ranges=[1e300, -1e300, 99.0])
    yield False, changed(log, "scan", 1, first=1e308, step=1e308)


def draw(source):
    def ranges():
        return [near(source, 0.15, 12.0, 0.0) for _ in range(source.choice([0, 1, 1, 2, 3, BEAMS]))]

    return drawn(
        source,
        list(nominal()),
        "scan",
        ranges=ranges,
        range_min=lambda: near(source, 0.15, 5.0, 12.0, 1e9),
        range_max=lambda: near(source, 12.0, 2.0, 0.15, 1e9),
        first=lambda: source.choice([math.nan, math.inf, 1e300, source.uniform(-4, 4)]),
        celsius=lambda: near(source, 30.0),
    )
