"""Puts what a robot sees on the map, by a tree of frames of which any may get another parent on the way."""

import math

import cachebox

REFUSED = (KeyError, RecursionError)  # a frame that is not known, or one that hangs in the air


def node(publish, checked):
    frames, places = {}, cachebox.LRUCache(64)

    @cachebox.cached(places)
    def place(name):
        if name == "map":
            return 0.0, 0.0, 0.0
        parent, x, y, yaw = frames[name]
        px, py, turn = place(parent)
        return px + x * math.cos(turn) - y * math.sin(turn), py + x * math.sin(turn) + y * math.cos(turn), turn + yaw

    def frame(m):
        if all(abs(m[each]) < 1e6 for each in ("x", "y", "yaw")):
            frames[m["name"]] = m["parent"], m["x"], m["y"], m["yaw"]
            places.clear()

    def seen(m):
        if checked:
            name, left = m["frame"], len(frames)
            while name != "map":
                name, left = frames[name][0], left - 1
                if left < 0:
                    raise RecursionError(name)
        x, y, turn = place(m["frame"])
        if not (0 <= m["range"] < 1e6 and abs(m["bearing"]) < 1e6):
            return
        east = x + m["range"] * math.cos(turn + m["bearing"])
        north = y + m["range"] * math.sin(turn + m["bearing"])
        publish("found", {"id": m["id"], "east": east, "north": north})

    return {"frame": frame, "seen": seen}
