"""Plans the ways of a shuttle in a round store of twelve columns and five rows, and compares them with the shortest."""

from pathfinding.core.grid import Grid
from pathfinding.finder.a_star import AStarFinder

COLUMNS, ROWS = 12, 5


def node(publish, checked):
    store, finder = Grid(width=COLUMNS, height=ROWS), AStarFinder()
    store.set_passable_left_right_border()

    def order(m):
        columns, rows = (m["from"], m["to"]), (m["from_row"], m["to_row"])
        if not all(0 <= column < COLUMNS for column in columns) or not all(0 <= row < ROWS for row in rows):
            return
        store.cleanup()
        start, end = (store.node(*place) for place in zip(columns, rows, strict=True))
        steps = len(finder.find_path(start, end, store)[0]) - 1
        along = abs(columns[0] - columns[1])
        shortest = min(along, COLUMNS - along) + abs(rows[0] - rows[1])
        publish("route", {"box": m["box"], "steps": steps, "extra": steps - shortest, "after": steps * 1.5})

    return {"order": order}
