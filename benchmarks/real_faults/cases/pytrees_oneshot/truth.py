"""Fails at odometry after a low battery, if half a metre was driven before, so that undocking was over."""

import math

from changes import changed, drawn, near, nth, without


def nominal():
    for i in range(80):
        if i % 4 == 0:
            volts = 12.4 - i * 0.01 - 0.1 * (i % 3)
            yield i * 0.1, "battery", {"volts": volts, "amperes": -2.0 - i % 5, "celsius": 25.0 + i / 20}
        yield (
            i * 0.1 + 0.02,
            "odometry",
            {"odometer": 17.0 + 0.06 * i, "heading": math.sin(i / 15), "slip": 0.01 * (i % 4)},
        )


def commands(log, *, once=True):
    """Yield what is to be done at each odometry."""
    volts, start, over = 12.6, None, False
    for _, topic, m in log:
        if topic == "battery":
            volts = m["volts"]
            continue
        if volts < 11.1:
            do, start, over = "charge", None, over and once
        elif over:
            do = "drive"
        else:
            start = m["odometer"] if start is None else start
            over = m["odometer"] - start >= 0.5
            do = "drive" if over else "undock"
        yield {"do": do, "heading": m["heading"]}


def fails(log):
    places = [index for index, (_, topic, _) in enumerate(log) if topic == "odometry"]
    pairs = zip(places, commands(log), commands(log, once=False), strict=True)
    return next((index for index, right, wrong in pairs if right["do"] != wrong["do"]), None)


def shows(log, outputs):
    return any(fields["do"] != right["do"] for (_, fields), right in zip(outputs, commands(log), strict=False))


def edges():
    log = list(nominal())
    low = math.nextafter(11.1, 0)
    yield True, changed(log, "battery", 5, volts=low)
    yield True, changed(log, "battery", 3, volts=10.0)
    yield True, changed(log, "battery", 18, volts=-1.0)
    yield False, changed(log, "battery", 5, volts=11.1)
    yield False, changed(log, "battery", 5, volts=math.nan)
    yield False, changed(log, "battery", 2, volts=low)
    yield False, changed(log, "battery", 0, volts=low)
    yield False, changed(log, "battery", -1, volts=low)
    yield True, without(changed(log, "battery", 5, volts=low), "battery", 6, 3)


def draw(source):
    log = drawn(
        source, list(nominal()), "battery", 2, volts=lambda: near(source, 11.1, 0.0), celsius=lambda: near(source, 25.0)
    )
    if source.random() < 0.3:
        log = without(log, source.choice(["battery", "odometry"]), source.randrange(20), source.randint(1, 12))
    if source.random() < 0.3:
        place = nth(log, "battery", source.randrange(-9, 9))
        log.insert(source.randrange(len(log)), log[place])
    if source.random() < 0.2:
        log = drawn(source, log, "odometry", 2, odometer=lambda: near(source, 17.0, 17.5, 20.0))
    return log
