"""Cleans the outlines of obstacles, and tells what area each takes; checks it against the outline as it came."""

from ladybug_geometry.geometry2d.pointvector import Point2D
from ladybug_geometry.geometry2d.polygon import Polygon2D

CELL, RANGE = 0.25, 50.0


def area(corners):
    """The area inside of corners, by the sum of triangles at the origin."""
    pairs = zip(corners, corners[1:] + corners[:1], strict=True)
    return abs(sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in pairs)) / 2


def node(publish, checked):
    def outline(m):
        corners = [(p["x"], p["y"]) for p in m["points"]]
        if m["height"] < 0.2 or not all(abs(each) <= RANGE for corner in corners for each in corner):
            return
        corners = [(round(x / CELL) * CELL, round(y / CELL) * CELL) for x, y in corners]  # of the map
        if len(corners) < 3 or area(corners) < 1.0:
            return
        found = Polygon2D([Point2D(x, y) for x, y in corners]).remove_colinear_vertices(0.0001)
        error = found.area - area(corners)
        publish("obstacle", {"label": m["label"], "corners": len(found.vertices), "area": found.area, "error": error})

    return {"outline": outline}
