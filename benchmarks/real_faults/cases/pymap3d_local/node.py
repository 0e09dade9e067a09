"""Puts fixes into metres east, north and up of the first good one, and adds up the way."""

import math

import pymap3d


def node(publish, checked):
    home, last, way = [], [0.0, 0.0, 0.0], 0.0

    def fix(m):
        nonlocal last, way
        if not (4 <= m["sats"] <= 100 and 0 <= m["hdop"] <= 20):
            return
        if not (-90 <= m["lat"] <= 90 and -180 <= m["lon"] <= 180 and -500 <= m["alt"] <= 50e3):
            return
        place = [m["lat"], m["lon"], m["alt"]]
        if not home:
            home.extend(place)
        here = [float(each) for each in pymap3d.geodetic2enu(*place, *home)]
        way, last = way + math.dist(here, last), here
        publish("local", {"east": here[0], "north": here[1], "up": here[2], "way": way, "sats": m["sats"]})

    return {"fix": fix}
