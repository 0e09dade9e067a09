"""Switches the lights of a vehicle by the height of the sun, and tells where the sun stands."""

import datetime

from astral import Observer
from astral.sun import azimuth, elevation


def node(publish, checked):
    on = False

    def fix(m):
        nonlocal on
        if not (-90 <= m["lat"] <= 90 and -180 <= m["lon"] <= 180 and 0 <= m["cloud"] <= 1):
            return
        if not 946684800 <= m["utc"] <= 4102444800:  # from 2000 to 2100
            return
        when = datetime.datetime.fromtimestamp(m["utc"], datetime.UTC)
        place = Observer(m["lat"], m["lon"])
        height = elevation(place, when)
        limit = 4 + 8 * m["cloud"]
        on = height < (limit + 1 if on else limit - 1)
        publish("lights", {"on": on, "height": height, "azimuth": azimuth(place, when), "id": m["id"][:32]})

    return {"fix": fix}
