"""Counts how often a vehicle has been in each cell of a geohash, to tell where it has searched."""

import pygeohash

REFUSED = (ValueError,)  # what encode raises for coordinates that it does not take


def node(publish, checked):
    visits = {}

    def fix(m):
        if m["quality"] < 1 or m["hdop"] > 5:
            return
        cell = pygeohash.encode(m["lat"], m["lon"], precision=8)
        visits[cell] = visits.get(cell, 0) + 1
        publish("cell", {"cell": cell, "visits": visits[cell], "cells": len(visits)})

    return {"fix": fix}
