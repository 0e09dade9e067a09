"""Plans the curve by which a harvester, which follows a row of plants, comes to the place where it has to turn off."""

import math

from pyclothoids import Clothoid

FIELD = 2000.0


def node(publish, checked):
    def plan(m):
        here, there = m["along"], m["turn_at"]
        if not (abs(here) <= FIELD and abs(there) <= FIELD):
            return
        if not (abs(m["heading"]) <= math.pi and abs(m["turn"]) <= math.pi):
            return
        if checked and here == there:
            return
        curve = Clothoid.G1Hermite(here, 0.0, m["heading"], there, 0.0, m["turn"])
        publish("curve", {"row": m["row"], "length": curve.length, "bend": curve.KappaStart})

    return {"plan": plan}
