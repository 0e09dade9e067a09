"""Tells whether a vehicle is in its fence, and how far from the border; the fence can be set anew on the way."""

import shapely


def near(value):
    return -1e5 <= value <= 1e5


def node(publish, checked):
    area = shapely.box(-100, -100, 100, 100)
    outside = 0

    def fence(m):
        nonlocal area
        points = m["points"]
        if not 3 <= len(points) <= 50 or not all(len(each) == 2 and near(each[0]) and near(each[1]) for each in points):
            return
        found = shapely.Polygon(points)
        if found.is_valid and found.area >= 1:
            area = found
            shapely.prepare(area)

    def pose(m):
        nonlocal outside
        if not (near(m["x"]) and near(m["y"]) and 0 <= m["speed"] <= 100):
            return
        here = shapely.Point(m["x"], m["y"])
        inside, metres = area.contains(here), area.exterior.distance(here)
        outside = 0 if inside else outside + 1
        publish("fence_state", {"inside": inside, "metres": metres, "area": area.area})
        if outside == 3 or (inside and metres < m["speed"]):
            publish("alarm", {"outside": not inside, "metres": metres})

    return {"fence": fence, "pose": pose}
