"""Fails at a pose in an area whose last permit was over when it came, while the one before would still be good."""

import math

from changes import changed, drawn, near, nth

AREAS = ("dock", "aisle", "gate")


def nominal():
    for i in range(80):
        stamp, area = 100.0 + i * 0.2, AREAS[i // 20 % 3]
        if i % 20 in (0, 8, 14):
            good, limit = (0.5, 0.4) if i % 20 == 8 else (5.0, 1.5)
            yield (
                i * 0.2,
                "permit",
                {"stamp": stamp, "area": area, "until": stamp + good, "limit": limit, "by": 7 + i % 3},
            )
        yield (
            i * 0.2 + 0.05,
            "pose",
            {"stamp": stamp + 0.05, "area": area, "offset": 0.2 * math.sin(i / 5), "speed": 0.9},
        )


def limits(log, *, replaced=True):
    """Yield index and limit for each pose."""
    clock, permits = 0.0, {}
    for index, (_, topic, m) in enumerate(log):
        clock = max(clock, m["stamp"])
        if topic == "permit":
            if replaced or clock < m["until"]:
                permits[m["area"]] = m
        else:
            found = permits.get(m["area"])
            yield index, found["limit"] if found and clock < found["until"] else 0.0


def fails(log):
    pairs = zip(limits(log), limits(log, replaced=False), strict=True)
    return next((index for (index, right), (_, wrong) in pairs if wrong != right), None)


def shows(log, outputs):
    return any(fields["limit"] != right for (_, fields), (_, right) in zip(outputs, limits(log), strict=False))


def late(log, number, seconds):
    """Return a log in which a permit comes late."""
    found = list(log)
    at, topic, m = found.pop(nth(log, "permit", number))
    return sorted([*found, (at + seconds, topic, m)], key=lambda each: each[0])


def edges():
    log = list(nominal())
    until = log[nth(log, "permit", 4)][2]["until"]
    yield True, changed(log, "permit", 4, until=100.0)
    yield True, changed(log, "permit", 4, until=until - 0.7)
    yield True, late(log, 4, 0.7)
    yield True, late(log, 4, 1.5)
    yield True, changed(log, "permit", 4, until=-math.inf)
    yield True, changed(log, "permit", 7, until=math.nan)
    yield False, changed(log, "permit", 4, until=until - 0.4)
    yield False, late(log, 4, 0.6)
    yield False, late(log, 4, 2.6)
    yield False, changed(log, "permit", 3, until=100.0)
    yield False, changed(log, "permit", 4, area="yard", until=100.0)


def draw(source):
    log = list(nominal())
    number = source.randrange(12)
    if source.random() < 0.5:
        return late(log, number, source.uniform(0.3, 2.7))
    stamp = log[nth(log, "permit", number)][2]["stamp"]
    return drawn(
        source,
        log,
        "permit",
        3,
        until=lambda: near(source, stamp, stamp + 3.0),
        area=lambda: source.choice(AREAS),
        limit=lambda: near(source, 0.5, 1.5),
        stamp=lambda: near(source, stamp, stamp + 3.0),
    )
