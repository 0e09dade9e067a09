"""Fails when more tracks have been removed than there are bays: of these, the tracker still holds each one.

A track is removed if the picture after its first one does not show it, or if none of six does later on; it is counted
again if the next one does not either. A bay has at most one track at a time, since carts stand still.
"""

import math

from changes import changed, drawn, near, without

BAYS, STAY = 12, 5
LEAVES, BLINKS = {2: 10, 7: 26, 4: 42, 10: 58}, {11: 35, 6: 50}


def nominal():
    for i in range(80):
        sure = []
        for k in range(BAYS):
            there = BLINKS[k] == i if k in BLINKS else k % 3 > 0 and i < LEAVES.get(k, 99)
            value = 0.7 + 0.15 * math.sin(i / 4 + k) if there else 0.04 + 0.01 * ((i + k) % 4)
            sure.append(0.18 if there and (5 * i + k) % 17 == 0 and i > 1 and k not in BLINKS else round(value, 4))
        yield i * 0.04, "picture", {"sure": sure, "light": 310 + 5 * (i % 8), "camera": 1}


def removed(log):
    """Yield after each picture how many tracks have been removed so far, counted as the tracker counts."""
    tracks, total = {}, 0  # for a bay: its state, when it was seen last, and whether it has been removed before
    for now, (_, _, m) in enumerate(log):
        for bay, sure in enumerate([*m["sure"][:BAYS], *[0.0] * (BAYS - len(m["sure"]))]):
            high, low = 0.25 < sure <= 1, 0.1 < sure < 0.25
            state, last, before = tracks.pop(bay, ("none", now, False))
            if state == "none":
                if high and sure >= 0.35:
                    tracks[bay] = "tracked" if now == 0 else "new", now, False
            elif state == "new":
                if high and sure >= 0.3:
                    tracks[bay] = "tracked", now, False
                else:
                    total += 1
            elif high or (low and state == "tracked"):
                tracks[bay] = "tracked", now, before
            elif state == "tracked":
                if not before:
                    tracks[bay] = "lost", last, False
            elif now - last > STAY:
                total += 1
                if state == "lost":
                    tracks[bay] = "gone", last, True
            else:
                tracks[bay] = "lost", last, False
        yield total


def fails(log):
    return next((index for index, total in enumerate(removed(log)) if total > BAYS), None)


def shows(log, outputs):
    return any(m["removed"] > BAYS for _, m in outputs)


def edges():
    log = list(nominal())
    assert list(removed(log))[-1] == 10
    empty = log[70][2]["sure"]
    flash = [0.9 if each < 0.1 else each for each in empty]
    yield True, changed(log, "picture", 70, sure=flash)
    yield False, changed(log, "picture", 70, sure=[*empty[:6], *flash[6:7], *empty[7:]])
    yield True, changed(log, "picture", 70, sure=flash)[:72]
    yield False, changed(log, "picture", 70, sure=flash)[:71]
    yield False, changed(log, "picture", 70, sure=[])
    yield False, changed(log, "picture", 70, sure=[math.nan, 1.1, -1.0, math.inf] * 3)
    away = log
    for number in range(71, 79):
        yield number >= 77, away
        away = changed(away, "picture", number, sure=[0.0] * BAYS)
    yield False, without(log, "picture", 30, 12)
    yield False, changed(log, "picture", 70, sure=[0.34] * BAYS)


def draw(source):
    def sure():
        values = [near(source, 0.17, 0.27, 0.33, 0.6, 0.04, 1.0) for _ in range(BAYS)]
        return [each for each in values if min(abs(each - limit) for limit in (0.3, 0.35, 0.1, 0.25)) > 1e-4]

    def blind():
        return [0.0] * BAYS

    log = list(nominal())
    if source.random() < 0.4:
        log = without(log, "picture", source.randrange(80), source.choice([1, 5, 15]))
    if source.random() < 0.6:
        first, count = source.randrange(60), source.choice([1, 4, 6, 7, 8, 12])
        for number in range(first, min(first + count, len(log))):
            log = changed(log, "picture", number, sure=blind() if source.random() < 0.97 else sure())
    return drawn(source, log, "picture", 3, sure=sure, light=lambda: near(source, 300.0))
