"""Fails at a landmark that is the fifth in its cell, of those that are on the map and whose score is enough."""

import math
from collections import Counter

from changes import changed, nth, without

HALF = 128.0


def nominal():
    for i in range(100):
        pole, turn = divmod(i, 5)
        x, y = 3.0 * pole - 30, 12.0 + pole % 3
        if turn == 4:
            yield i * 0.2, "robot", {"x": x, "y": 11.0, "heading": 0.1 * math.sin(i)}
        else:
            score = 0.6 + (i * 7 % 10) / 30
            x, y = x + 0.05 * math.sin(i), y + 0.05 * math.cos(i)
            yield i * 0.2, "landmark", {"label": ["pole", "tree"][pole % 2], "x": x, "y": y, "score": score}


def fails(log):
    cells = Counter()
    for index, (_, topic, m) in enumerate(log):
        if topic == "landmark" and not m["score"] < 0.5 and abs(m["x"]) <= HALF and abs(m["y"]) <= HALF:
            cell = (round(m["x"] * 8), round(m["y"] * 8))
            cells[cell] += 1
            if cells[cell] > 4:
                return index


def again(log, number, times=1, **fields):
    """The log with an input of a landmark repeated, with new fields."""
    place = nth(log, "landmark", number)
    seconds, topic, m = log[place]
    return [*log[: place + 1], *[(seconds, topic, m | fields)] * times, *log[place + 1 :]]


def edges():
    log = list(nominal())
    x = log[0][2]["x"]
    yield True, again(log, 3)
    yield True, again(log, 0)
    yield True, [*log, log[0]]
    yield True, changed(log, "landmark", **{name: log[0][2][name] for name in ("x", "y")})
    yield True, again(log, 3, x=x + 0.06)
    yield False, again(log, 3, x=x + 0.13)
    yield False, again(log, 3, score=0.49)
    yield False, again(without(log, "landmark", 2), 2)
    yield True, again(without(log, "landmark", 2), 2, 2)
    yield False, again(log, 3, 4, x=0.0)
    yield True, again(log, 3, 5, x=-0.0)
    yield True, again(log, 3, 5, x=HALF, y=-HALF, score=math.nan)
    yield False, again(log, 3, 5, x=128.01)


def draw(source):
    log, number = list(nominal()), source.randrange(80)
    if source.random() < 0.4:
        log = without(log, "landmark", source.randrange(70), source.randint(1, 3))
        number = source.randrange(70)
    to = log[nth(log, "landmark", source.randrange(70))][2]
    moved = {"x": to["x"] + source.uniform(-0.15, 0.15), "y": to["y"]}
    fields = source.choice([{}, moved, {"x": source.uniform(-140, 140)}, {"score": source.uniform(0.3, 0.7)}])
    return again(log, number, source.randint(1, 3), **fields)
