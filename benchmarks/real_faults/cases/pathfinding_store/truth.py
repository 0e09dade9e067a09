"""Fails at an order whose columns are more than half of the store apart, unless the way around begins at its seam."""

from changes import changed, drawn, near_integer

COLUMNS, ROWS = 12, 5


def nominal():
    for i in range(90):
        column = i * 5 % COLUMNS
        other = min(max(column + i % 11 - 5, 0), COLUMNS - 1)
        yield (
            i * 0.5,
            "order",
            {"box": 400 + i, "from": column, "from_row": i % ROWS, "to": other, "to_row": i // 3 % ROWS},
        )


def fails(log):
    for index, (_, _, m) in enumerate(log):
        within = all(0 <= m[name] < COLUMNS for name in ("from", "to"))
        if not within or not all(0 <= m[name] < ROWS for name in ("from_row", "to_row")):
            continue
        if abs(m["from"] - m["to"]) * 2 > COLUMNS and 0 < m["from"] < COLUMNS - 1:
            return index


def edges():
    log = list(nominal())
    yield True, changed(log, "order", **{"from": 1, "to": 8})
    yield False, changed(log, "order", **{"from": 1, "to": 7})
    yield True, changed(log, "order", 20, **{"from": 10, "to": 3})
    yield False, changed(log, "order", 20, **{"from": 10, "to": 4})
    yield False, changed(log, "order", **{"from": 0, "to": 11})
    yield False, changed(log, "order", **{"from": 11, "to": 0})
    yield False, changed(log, "order", **{"from": 0, "to": 7})
    yield True, changed(log, "order", **{"from": 1, "to": 11, "from_row": 4, "to_row": 0})
    yield False, changed(log, "order", **{"from": 1, "to": 12})
    yield False, changed(log, "order", **{"from": 1, "to": 11, "to_row": ROWS})


def draw(source):
    log = list(nominal())
    return drawn(
        source,
        log,
        "order",
        4,
        **{name: lambda: near_integer(source, 0, 3, 8, COLUMNS - 1) % 14 for name in ("from", "to")},
        to_row=lambda: source.randrange(-1, ROWS + 1),
    )


def shows(log, outputs):
    return any(m["extra"] > 0 for _, m in outputs)
