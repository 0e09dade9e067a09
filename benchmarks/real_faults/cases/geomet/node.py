"""Writes a robot's last fixes as a line for a map, in well-known text."""

from collections import deque

from geomet import wkt


def node(publish, checked):
    last = deque(maxlen=4)

    def fix(m):
        if m["quality"] == 0 or not (-90 <= m["lat"] <= 90 and -180 <= m["lon"] <= 180 and -500 <= m["alt"] <= 9000):
            return
        last.append([float(m["lon"]), float(m["lat"]), float(m["alt"])])
        if len(last) == last.maxlen:
            line = {"type": "LineString", "coordinates": list(last)}
            publish("track", {"wkt": wkt.dumps(line, decimals=5), "satellites": m["satellites"]})

    return {"fix": fix}
