"""Turns the solutions of a receiver, which are from the centre of the earth, into fixes, and checks their altitude."""

import math

import pymap3d

MAJOR, MINOR = 6378137.0, 6356752.31424518
SQUARED = 1 - (MINOR / MAJOR) ** 2


def height(x, y, z):
    """The height above the ellipsoid, by iteration."""
    flat = math.hypot(x, y)
    lat = math.atan2(z, flat * (1 - SQUARED))
    for _ in range(8):
        sine = math.sin(lat)
        lat = math.atan2(z + SQUARED * MAJOR * sine / math.sqrt(1 - SQUARED * sine**2), flat)
    sine = math.sin(lat)
    return flat * math.cos(lat) + z * sine - MAJOR * math.sqrt(1 - SQUARED * sine**2)


def node(publish, checked):
    def solution(m):
        x, y, z = m["x"], m["y"], m["z"]
        if m["satellites"] < 4 or not 6.25e6 < math.hypot(x, y, z) < 6.45e6:
            return
        lat, lon, alt = (float(each) for each in pymap3d.ecef2geodetic(x, y, z))
        publish("fix", {"lat": lat, "lon": lon, "alt": alt, "error": alt - height(x, y, z)})

    return {"solution": solution}
