"""Fails at a reading that is used while it, or the temperature wanted, is NaN; infinity is cut to what is possible."""

import math

from changes import changed, drawn, near, nth, without

NAN = math.nan


def nominal():
    for i in range(100):
        if i % 10 == 0:
            yield i * 0.1, "wanted", {"celsius": 20.0 + (i // 10) % 4, "source": "plan"}
        else:
            celsius = 12.0 + 0.09 * i + 0.3 * math.sin(i / 3)
            yield i * 0.1, "reading", {"celsius": celsius, "humidity": 40.0 + i % 5, "volts": 12.4 - 0.004 * i}


def fails(log):
    wanted = 20.0
    for index, (_, topic, m) in enumerate(log):
        if topic == "wanted":
            wanted = m["celsius"]
        elif not m["volts"] < 9 and (math.isnan(m["celsius"]) or math.isnan(wanted)):
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "reading", 5, celsius=NAN)
    yield True, changed(log, "reading", celsius=NAN)
    yield True, changed(log, "reading", 40, celsius=NAN, volts=NAN)
    yield True, changed(log, "wanted", celsius=NAN)
    yield False, changed(log, "reading", 5, celsius=math.inf)
    yield False, changed(changed(log, "reading", 5, celsius=-math.inf), "wanted", 2, celsius=math.inf)
    yield False, changed(log, "reading", 5, celsius=1e308)
    yield False, changed(log, "reading", 5, celsius=NAN, volts=8.9)
    yield False, changed(log, "reading", 5, humidity=NAN, volts=NAN)
    last = changed(log, "wanted", celsius=NAN)
    yield False, last[: nth(last, "wanted") + 1]


def draw(source):
    log = list(nominal())
    if source.random() < 0.5:
        return drawn(source, log, "wanted", 3, celsius=lambda: source.choice([NAN, 45.0, near(source, 0.0, 45.0)]))
    found = drawn(
        source,
        log,
        "reading",
        3,
        celsius=lambda: source.choice([NAN, NAN, -40.0, math.inf, near(source, -40.0, 125.0, 1e300)]),
        humidity=lambda: source.choice([NAN, 50.0]),
        volts=lambda: source.choice([NAN, near(source, 9.0)]),
    )
    return without(found, "reading", source.randrange(90), source.randrange(3))
