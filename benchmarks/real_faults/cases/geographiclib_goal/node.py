"""Tells distance and bearing from each position to the goal that was set last."""

from geographiclib.geodesic import Geodesic

EARTH = Geodesic.WGS84


def right(m):
    return -90 <= m["lat"] <= 90 and -180 <= m["lon"] <= 180


def node(publish, checked):
    aim = {}

    def goal(m):
        if right(m) and 0.5 <= m["radius"] <= 1000:
            aim.update(lat=m["lat"], lon=m["lon"], radius=m["radius"], name=m["name"][:40])

    def position(m):
        if not (aim and right(m) and 0 <= m["heading"] < 360):
            return
        line = EARTH.Inverse(m["lat"], m["lon"], aim["lat"], aim["lon"])
        bearing = line["azi1"] % 360
        turn = (bearing - m["heading"] + 180) % 360 - 180
        reached = line["s12"] <= aim["radius"]
        publish("course", {"goal": aim["name"], "metres": line["s12"], "turn": turn, "reached": reached})

    return {"goal": goal, "position": position}
