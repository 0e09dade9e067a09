"""The nodes of the stack: `node.py ROLE ENDPOINT [--seed N] [--duration S] [--speed X]`.

The outside: `gps` tells where the vehicle is, `operator` where it shall go. The inside: `locator` turns a fix into
metres east and north of the base (pymap3d), `tracker` smoothes them (filterpy), `planner` finds a path over the map
(pathfinding), and `controller` steers towards its next cell (simple-pid).
"""

from __future__ import annotations

import argparse
import json
import math
import random
import threading
import time
from collections.abc import Callable
from typing import Any

import zenoh

BASE = (47.3977, 8.5456, 488.0)
"""Latitude and longitude in degrees, height in metres."""
METRES_PER_DEGREE = 111_320.0
SIDE, CELL = 40, 3.0
"""Cells of the map along each side, and their metres; the base is in its middle."""
WALL = range(8, 30)
Handler = Callable[[dict[str, float]], "dict[str, Any] | None"]


def connect(endpoint: str) -> zenoh.Session:
    """Return a client session."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    return zenoh.open(config)


def tell(
    session: zenoh.Session, key: str, rate: float, options: argparse.Namespace, say: Callable[[float], Any]
) -> None:
    """Publish what `say` returns for each moment, once somebody listens."""
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    listened = threading.Event()
    listener = publisher.declare_matching_listener(lambda status: listened.set() if status.matching else None)
    if publisher.matching_status.matching:
        listened.set()
    listened.wait(5)
    start = time.monotonic()
    for tick in range(int(options.duration * rate)):
        time.sleep(max(0.0, start + tick / rate / options.speed - time.monotonic()))
        publisher.put(json.dumps(say(tick / rate)))
    listener.undeclare()


def serve(session: zenoh.Session, key: str, handlers: dict[str, tuple[tuple[str, ...], Handler]]) -> None:
    """Answer messages that have the numbers which their handler needs; others are passed over."""
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    inbox: zenoh.handlers.FifoChannel = zenoh.handlers.FifoChannel(1000)
    with session.declare_subscriber("*", inbox) as samples:
        for sample in samples:
            names, handle = handlers.get(str(sample.key_expr), ((), None))
            try:
                said = json.loads(sample.payload.to_bytes())
                values = {name: float(said[name]) for name in names}
            except (ValueError, KeyError, TypeError, OverflowError):
                continue
            if handle is not None and all(map(math.isfinite, values.values())):
                answer = handle(values)
                if answer is not None:
                    publisher.put(json.dumps(answer))


def gps(session: zenoh.Session, options: argparse.Namespace) -> None:
    """Tell where a vehicle is that stays within 35 m of the base."""
    noise = random.Random(options.seed)

    def say(now: float) -> dict[str, float]:
        east, north = 30 * math.sin(now / 12), 25 * math.cos(now / 9)
        return {
            "lat": BASE[0] + (north + noise.gauss(0, 0.5)) / METRES_PER_DEGREE,
            "lon": BASE[1] + (east + noise.gauss(0, 0.5)) / METRES_PER_DEGREE / math.cos(math.radians(BASE[0])),
            "alt": BASE[2] + noise.gauss(0, 1),
            "satellites": noise.randint(8, 14),
        }

    tell(session, "gps", 10.0, options, say)


def operator(session: zenoh.Session, options: argparse.Namespace) -> None:
    """Tell another goal each second."""
    noise = random.Random(options.seed + 1)
    tell(session, "goal", 1.0, options, lambda _: {"x": noise.uniform(-50, 50), "y": noise.uniform(-50, 50)})


def locator(session: zenoh.Session) -> None:
    """Turn fixes into metres east and north of the base."""
    from pymap3d import geodetic2enu

    def place(fix: dict[str, float]) -> dict[str, float] | None:
        try:
            east, north, _ = geodetic2enu(fix["lat"], fix["lon"], fix["alt"], *BASE)
        except ValueError:  # no latitude
            return None
        return {"east": float(east), "north": float(north)}

    serve(session, "place", {"gps": (("lat", "lon", "alt"), place)})


def tracker(session: zenoh.Session) -> None:
    """Smooth places, and tell velocities."""
    import numpy as np
    from filterpy.kalman import KalmanFilter

    step, filters = 0.1, []
    for _ in range(2):
        one = KalmanFilter(dim_x=2, dim_z=1)
        one.F, one.H = np.array([[1, step], [0, 1]]), np.array([[1.0, 0.0]])
        one.P, one.R, one.Q = np.eye(2) * 100, np.array([[0.5]]), np.diag([0.01, 0.5])
        filters.append(one)

    def track(place: dict[str, float]) -> dict[str, float]:
        for one, value in zip(filters, (place["east"], place["north"]), strict=True):
            one.predict()
            one.update(value)
        x, y = (one.x.ravel().tolist() for one in filters)
        return {"x": x[0], "y": y[0], "vx": x[1], "vy": y[1]}

    serve(session, "state", {"place": (("east", "north"), track)})


def planner(session: zenoh.Session) -> None:
    """Find a path over the map from the vehicle to its goal, and tell the next place on it."""
    from pathfinding.core.grid import Grid
    from pathfinding.finder.a_star import AStarFinder

    cells = [[0 if row == SIDE // 2 and column in WALL else 1 for column in range(SIDE)] for row in range(SIDE)]
    grid, finder, goals = Grid(matrix=cells), AStarFinder(), [(SIDE // 2, SIDE // 2)]

    def cell(x: float, y: float) -> tuple[int, int]:
        return int(x // CELL) + SIDE // 2, int(y // CELL) + SIDE // 2

    def aim(goal: dict[str, float]) -> None:
        column, row = cell(goal["x"], goal["y"])
        if 0 <= column < SIDE and 0 <= row < SIDE:  # of a state, nobody checks that
            goals[0] = column, row

    def plan(state: dict[str, float]) -> dict[str, Any]:
        grid.cleanup()
        start = grid.node(*cell(state["x"], state["y"]))
        path, _ = finder.find_path(start, grid.node(*goals[0]), grid)
        following = path[min(1, len(path) - 1)] if path else start
        middle = [CELL * (place - SIDE / 2 + 0.5) for place in (following.x, following.y)]
        return {"x": middle[0], "y": middle[1], "length": len(path)}

    serve(session, "path", {"goal": (("x", "y"), aim), "state": (("x", "y"), plan)})


def controller(session: zenoh.Session) -> None:
    """Steer towards the next place of the path."""
    from simple_pid import PID

    loops = {name: PID(0.8, 0.05, 0.1, sample_time=None, output_limits=(-3, 3)) for name in "xy"}

    def aim(goal: dict[str, float]) -> None:
        for name, loop in loops.items():
            loop.setpoint = goal[name]

    def steer(state: dict[str, float]) -> dict[str, float]:
        return {name: float(loop(state[name], dt=0.1)) for name, loop in loops.items()}

    serve(session, "command", {"path": (("x", "y"), aim), "state": (("x", "y"), steer)})


def main() -> None:
    """Be one of the nodes."""
    parser = argparse.ArgumentParser(description=__doc__)
    outside = {"gps": gps, "operator": operator}
    inside = {"locator": locator, "tracker": tracker, "planner": planner, "controller": controller}
    parser.add_argument("role", choices=[*outside, *inside])
    parser.add_argument("endpoint")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--duration", type=float, default=40.0, help="simulated seconds")
    parser.add_argument("--speed", type=float, default=1.0, help="how much faster than real time")
    options = parser.parse_args()
    with connect(options.endpoint) as session:
        if options.role in outside:
            outside[options.role](session, options)
        else:
            inside[options.role](session)


if __name__ == "__main__":
    main()
