"""Fails at a plan to turn off at the very place where the harvester is, whatever the headings are."""

import math

from changes import changed, near

FIELD = 2000.0


def nominal():
    for i in range(72):
        row, step = divmod(i, 12)
        heading = 0.05 * math.sin(i / 2)
        turn_at = 60.0 + 2 * row
        yield (
            i * 0.5,
            "plan",
            {
                "row": row,
                "along": 4.75 * step + 0.3 * row,
                "turn_at": turn_at,
                "heading": heading,
                "turn": 0.4 - row / 9,
            },
        )


def fails(log):
    for index, (_, _, m) in enumerate(log):
        angles = abs(m["heading"]) <= math.pi and abs(m["turn"]) <= math.pi
        if angles and m["along"] == m["turn_at"] and abs(m["along"]) <= FIELD:
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "plan", along=70.0)
    yield True, changed(log, "plan", 20, turn_at=log[20][2]["along"])
    yield True, changed(log, "plan", along=0.0, turn_at=-0.0, heading=math.pi)
    yield True, changed(log, "plan", along=FIELD, turn_at=FIELD, heading=0.0, turn=0.0)
    yield False, changed(log, "plan", along=math.nextafter(70.0, 100))
    yield False, changed(log, "plan", along=0.0, turn_at=5e-324)
    yield False, changed(log, "plan", along=70.5)
    yield False, changed(log, "plan", along=70.0, turn=3.2)
    yield False, changed(log, "plan", along=2000.1, turn_at=2000.1)
    yield False, changed(log, "plan", along=math.inf, turn_at=math.inf)


def draw(source):
    log, number = list(nominal()), source.randrange(72)
    here = source.choice([0.0, log[number][2]["along"], near(source, FIELD, -FIELD), source.uniform(-3000, 3000)])
    there = source.choice([here, here, near(source, here), log[number][2]["turn_at"]])
    angles = {name: source.choice([0.0, near(source, math.pi, -math.pi, 0.0)]) for name in ("heading", "turn")}
    return changed(log, "plan", number, along=here, turn_at=there, **source.choice([{}, {}, angles]))
