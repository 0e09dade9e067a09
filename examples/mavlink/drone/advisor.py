"""How high the drone is above the ground below it: from `/drone/fix` to `/drone/clearance`. `python -m drone.advisor`.

It knows nothing of MAVLink.
"""

from __future__ import annotations

import argparse
from math import isfinite, sin

import zenoh
from zenoh import handlers

from drone.ros import CLEARANCE, FIX, Session, number, read_fix

SOUTH, WEST = 47.37, 8.51
STEP = 0.001
CELLS = 60
CHANNEL = 8192

TERRAIN = [[480 + 8 * sin(row / 7) + 6 * sin(column / 5) for column in range(CELLS)] for row in range(CELLS)]
"""Metres above sea level, by cells of 0.001 degrees from the corner in the south-west."""


def ground(latitude: float, longitude: float) -> float:
    """Return how high the ground is; places south or west of the tile get its edge."""
    row, column = (max(0, int((value - edge) / STEP)) for value, edge in ((latitude, SOUTH), (longitude, WEST)))
    return TERRAIN[row][column]


def main() -> None:
    """Run as a process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--zenoh", default="tcp/127.0.0.1:7447", help="endpoint of the router")
    options = parser.parse_args()
    with Session(options.zenoh) as session:
        clearances = session.publisher(CLEARANCE)
        channel: handlers.FifoChannel[zenoh.Sample] = handlers.FifoChannel(CHANNEL)
        fixes = session.session.declare_subscriber(FIX, channel)
        for sample in fixes:
            try:
                place = read_fix(sample.payload.to_bytes())
            except ValueError:
                continue
            if all(map(isfinite, place)):
                clearances.put(number(place[2] - ground(*place[:2])))


if __name__ == "__main__":
    main()
