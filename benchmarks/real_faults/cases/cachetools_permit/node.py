"""Says at each pose whether the vehicle may drive on, by the last permit for its area, which is good until a time."""

import math

from cachetools import TLRUCache


def node(publish, checked):
    clock = [0.0]
    permits = TLRUCache(maxsize=1000, ttu=lambda area, permit, now: permit["until"], timer=lambda: clock[0])

    last = {}

    def permit(m):
        clock[0] = max(clock[0], m["stamp"])
        permits[m["area"]] = last[m["area"]] = {"until": m["until"], "limit": m["limit"]}

    def pose(m):
        clock[0] = max(clock[0], m["stamp"])
        found = permits.get(m["area"])
        limit = found["limit"] if found else 0.0
        over = m["area"] not in last or not clock[0] < last[m["area"]]["until"]
        publish("drive", {"area": m["area"], "limit": limit, "over": over, "turn": -math.atan2(m["offset"], 3.0)})

    return {"permit": permit, "pose": pose}
