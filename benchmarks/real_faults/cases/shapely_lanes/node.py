"""Tells how much of the lanes in the window around a vehicle others will soon take; their latest tracks count."""

import shapely

HALF = 20.0


def near(*values):
    return all(abs(each) < 1e6 for each in values)


def node(publish, checked):
    tracks = {}

    def track(m):
        if near(m["x"], m["y"]) and 1 <= m["ahead"] <= 60:
            tracks[m["id"]] = shapely.LineString([(m["x"], m["y"]), (m["x"] + m["ahead"], m["y"])])

    def pose(m):
        if not tracks or not near(m["x"], m["y"]):
            return
        window = shapely.box(m["x"] - HALF, m["y"] - HALF, m["x"] + HALF, m["y"] + HALF)
        parts = [each.intersection(window) for each in tracks.values()]
        if checked:
            parts = [each for each in parts if not each.is_empty]
        lanes = shapely.node(shapely.GeometryCollection(parts))
        publish("occupied", {"metres": lanes.length, "pieces": shapely.get_num_geometries(lanes).item()})

    return {"track": track, "pose": pose}
