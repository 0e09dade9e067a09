"""Fails after a marker has gone while one that came later is there: when that one goes, or at the marker after it."""

import math

from changes import changed, drawn, near, nth, without


def nominal():
    for i in range(90):
        at, marker, step = i * 0.1, f"T{i // 9 * 5 % 17}", i % 9
        if step < 8:
            yield (
                at,
                "seen",
                {"marker": marker, "x": 3.0 - 0.3 * step, "y": 0.4 * math.sin(i), "yaw": 0.1 * step, "px": 40},
            )
        else:
            yield at, "gone", {"marker": marker, "frames": 24, "cause": "left"}


def fails(log):
    numbers, edges = {}, ["camera"]
    for index, (_, topic, m) in enumerate(log):
        marker = m["marker"]
        if topic == "gone" and marker in numbers:
            number = numbers.pop(marker)
            if number >= len(edges):
                return index
            del edges[number]
        elif topic == "seen" and all(math.isfinite(m[key]) for key in ("x", "y", "yaw")):
            if marker not in numbers:
                numbers[marker] = len(edges)
                edges.append(marker)
            if marker not in ("vehicle", *edges):
                return index
    return None


def late(log, number, steps):
    """Return a log in which a marker's going is told some inputs later."""
    found = list(log)
    place = nth(log, "gone", number)
    _, topic, m = found.pop(place)
    at = found[place + steps - 1][0] + 0.01
    return [*found[: place + steps], (at, topic, m), *found[place + steps :]]


def edges():
    log = list(nominal())
    yield True, late(log, 3, 1)
    yield True, late(log, 3, 8)
    yield False, late(log, 3, 9)
    yield True, late(log, 0, 40)
    yield False, changed(log, "seen", 20, marker="T99")
    yield False, late(log, -2, 1)[:-1]
    yield False, without(log, "gone", 3)
    yield False, changed(log, "gone", 3, marker="T99")
    yield False, changed(log, "seen", 23, marker="T99")
    yield False, changed(log, "seen", 20, x=math.nan)


def draw(source):
    log = list(nominal())
    match source.randrange(4):
        case 0:
            return late(log, source.randrange(8), source.randint(1, 12))
        case 1:
            log = without(log, source.choice(["seen", "gone"]), source.randrange(10), source.randint(1, 9))
            return late(log, 0, source.randint(1, 12)) if source.random() < 0.5 else log
        case 2:
            marker = lambda: source.choice(["T5", "T0", "T10", "T99", "camera", "vehicle", ""])  # noqa: E731
            return drawn(source, log, source.choice(["seen", "gone"]), 2, marker=marker)
    places = {key: lambda: near(source, 0.0, 1e300, math.pi) for key in ("x", "y", "yaw")}
    return drawn(source, log, "seen", 3, marker=lambda: f"T{source.randrange(17)}", **places)
