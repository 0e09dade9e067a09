"""Can fail at the first near scan after free ones, since it cancels a timer whose turn may be waiting just then.

The timer has to have come to its first turn, and scans have to follow, since it is the next one that tells.
"""

import math

from changes import changed, drawn, near

NEAR_M, PERIOD_S, TOLD_S = 0.4, 0.017, 0.1


def nominal():
    for i in range(80):
        yield (
            i * 0.01,
            "scan",
            {
                "nearest": 2.2 + math.sin(i / 7) + 0.05 * (i % 3),
                "bearing": 0.8 * math.cos(i / 13),
                "rays": 360 - 8 * (i % 5),
            },
        )


def fails(log):
    free = True
    for index, (seconds, _, m) in enumerate(log):
        stops = free and m["nearest"] < NEAR_M
        if stops and seconds - log[0][0] > PERIOD_S and log[-1][0] - seconds > TOLD_S:
            return index
        free = not m["nearest"] < NEAR_M


def edges():
    log = list(nominal())
    yield True, changed(log, "scan", 40, nearest=0.39)
    yield True, changed(log, "scan", 25, nearest=-1.0)
    yield True, changed(changed(log, "scan", 50, nearest=0.1), "scan", 51, nearest=0.2)
    yield False, changed(log, "scan", 40, nearest=NEAR_M)
    yield False, changed(log, "scan", 40, nearest=math.nan)
    yield False, changed(log, "scan", 40, nearest=math.inf, bearing=-math.inf)
    yield False, changed(log, "scan", nearest=0.1)


def draw(source):
    return drawn(
        source,
        list(nominal()),
        "scan",
        nearest=lambda: near(source, NEAR_M, 0.0),
        bearing=lambda: near(source, 0.0, math.pi),
        rays=lambda: source.randint(0, 720),
    )
