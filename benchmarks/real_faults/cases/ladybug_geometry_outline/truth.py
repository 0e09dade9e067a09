"""Fails where a corner that is needed for the area comes twice or more in a row, unless it is the last, twice."""

import math

from changes import changed

CELL, RANGE, LIMIT = 0.25, 50.0, 0.1


def nominal():
    for i in range(64):
        x, y, w, h = 6 * math.sin(i / 5), 9 + i % 7, 3.0 + i % 4, 2.5 + i % 5 / 2
        shape = [(0, 0), (w / 2, 0), (w, 0), (w, h), (w - 1.5, h), (w - 1.5, h - 1), (0, h - 1)]
        points = [{"x": x + a, "y": y + b} for a, b in shape[i % 3 % 2 :]]
        yield (
            i * 0.2,
            "outline",
            {"label": ["crate", "shrub", "wall"][i % 3], "height": 0.5 + i % 6 / 4, "points": points},
        )


def corners(m):
    """The corners in the cells of the map, none if the outline is not used."""
    values = [(p["x"], p["y"]) for p in m["points"]]
    if m["height"] < 0.2 or not all(abs(each) <= RANGE for value in values for each in value):
        return []
    found = [(round(x / CELL), round(y / CELL)) for x, y in values]
    return found if len(found) > 2 and area(found) >= 1 else []


def area(found):
    return abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(found, found[1:] + found[:1], strict=True))) / 2 * CELL**2


def lost(m):
    """How much area is lost by leaving out each corner that is on a line with its neighbours, or is one of them."""
    found = corners(m)
    around = zip(found[-1:] + found, found, found[1:] + found[:1], strict=False)
    kept = [b for a, b, c in around if turns(a, b, c)]
    if found and found[-1] == found[-2] and turns(found[-3], found[-1], found[0]):  # the last twice is taken care of
        kept.append(found[-1])
    return abs(area(found) - area(kept))


def turns(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) != (b[1] - a[1]) * (c[0] - a[0])


def fails(log):
    return next((index for index, (_, _, m) in enumerate(log) if lost(m) > LIMIT), None)


def repeated(log, number, corner, times=1, where=None):
    """The log with a corner of an outline repeated behind itself, or elsewhere."""
    points = list(log[number][2]["points"])
    place = corner + 1 if where is None else where
    return changed(log, "outline", number, points=points[:place] + points[corner : corner + 1] * times + points[place:])


def edges():
    log = list(nominal())
    yield True, repeated(log, 30, 0)
    yield True, repeated(log, 30, 3, 2)
    yield True, repeated(log, 30, 0, where=7)
    yield True, repeated(log, 30, 6, 2)
    yield False, repeated(log, 30, 6)
    yield False, repeated(log, 30, 1)
    yield False, repeated(log, 30, 3, where=5)
    yield False, changed(repeated(log, 30, 0), "outline", 30, height=0.1)
    yield False, changed(log, "outline", 30, points=log[30][2]["points"][:2])
    near = repeated(log, 30, 3)[30][2]["points"]
    yield True, changed(log, "outline", 30, points=[p | {"x": p["x"] + 0.01 * (i == 4)} for i, p in enumerate(near)])
    yield False, changed(log, "outline", 30, points=[p | {"x": p["x"] + 0.3 * (i == 4)} for i, p in enumerate(near)])


def draw(source):
    log, number = list(nominal()), source.randrange(64)
    points = list(log[number][2]["points"])
    corner = source.randrange(len(points))
    if source.random() < 0.6:
        return repeated(log, number, corner, source.randint(1, 2), source.choice([None, None, source.randrange(7)]))
    to = points[corner - 1] if source.random() < 0.4 else {"x": source.uniform(-60, 60), "y": source.uniform(-60, 60)}
    points[corner] = points[corner] | {name: to[name] for name in source.sample(["x", "y"], source.randint(1, 2))}
    return changed(log, "outline", number, points=points)


def shows(log, outputs):
    return any(abs(m["error"]) > LIMIT for _, m in outputs) or len(outputs) < sum(bool(corners(m)) for _, _, m in log)
