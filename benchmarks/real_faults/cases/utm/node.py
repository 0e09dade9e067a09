"""Puts fixes on the UTM grid, and back, as a map server does."""

import utm


def node(publish, checked):
    def fix(m):
        if not (-80 <= m["lat"] <= 84 and -180 <= m["lon"] <= 180):
            return
        place = utm.from_latlon(m["lat"], m["lon"])
        lat, lon = utm.to_latlon(*place)
        publish("grid", {"east": place[0], "north": place[1], "zone": place[2], "lat": float(lat), "lon": float(lon)})

    return {"fix": fix}
