"""Tells how far the corners of a robot are from what its scanner sees; beams without a proper echo are no points."""

import numpy as np
from pykdtree.kdtree import KDTree

REFUSED = (ValueError,)  # the library's word for points that it cannot take
CORNERS = np.array([[0.4, 0.3], [0.4, -0.3], [-0.4, -0.3], [-0.4, 0.3]])


def node(publish, checked):
    def scan(m):
        ranges = np.array(m["ranges"], dtype=float)
        angles = m["first"] + m["step"] * np.arange(len(ranges))
        points = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
        seen = (ranges >= m["range_min"]) & (ranges <= m["range_max"]) & (ranges >= 0) & (ranges < 100)
        points = points[seen & np.isfinite(angles)]
        metres, nearest = KDTree(points).query(CORNERS, k=1)
        corner = int(metres.argmin())
        publish(
            "clearance",
            {"metres": float(metres[corner]), "corner": corner, "at": points[nearest[corner]].tolist()},
        )

    return {"scan": scan}
