"""Keeps where landmarks were seen, in cells of an eighth of a metre, and tells how many are near the robot."""

import quads

HALF = 128.0


def node(publish, checked):
    seen = quads.QuadTree((0.0, 0.0), 2 * HALF, 2 * HALF)

    def landmark(m):
        x, y = m["x"], m["y"]
        if m["score"] < 0.5 or not (abs(x) <= HALF and abs(y) <= HALF):
            return
        place = (round(x * 8) / 8, round(y * 8) / 8)
        if not (checked and place in seen):
            seen.insert(place, data=m["label"])

    def robot(m):
        x, y = m["x"], m["y"]
        if abs(x) <= HALF and abs(y) <= HALF:
            found = seen.within_bb(quads.BoundingBox(x - 5, y - 5, x + 5, y + 5))
            publish("near", {"seen": len(found), "labels": sorted({point.data for point in found})})

    return {"landmark": landmark, "robot": robot}
