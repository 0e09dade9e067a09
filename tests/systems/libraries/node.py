"""Thin nodes around libraries: `node.py KIND ENDPOINT` feeds a library from Zenoh and publishes its results.

What a library refuses by raising ValueError is refused here too, with a line on stderr: that is its documented way.
So is what has another form than `FORMS`, as no message has that comes typed from ROS, say.
"""

import json
import sys
import threading

import zenoh

KIND, ENDPOINT = sys.argv[1:3]
FORMS = {
    "map": {"cells": [[1]]},
    "query": dict.fromkeys(("x0", "y0", "x1", "y1"), 0),
    "tuning": dict.fromkeys(("setpoint", "kp", "ki", "kd", "low", "high"), 0.0),
    "measured": dict.fromkeys(("value", "dt"), 0.0),
    "position": dict.fromkeys(("z", "variance", "dt") if KIND == "unscented" else ("z", "variance"), 0.0),
    "home": dict.fromkeys(("lat", "lon", "alt"), 0.0),
    "fix": dict.fromkeys(("lat", "lon", "alt"), 0.0),
}


def has_form(value, form):
    if isinstance(form, dict):
        return (
            isinstance(value, dict) and value.keys() == form.keys() and all(has_form(value[k], form[k]) for k in form)
        )
    if isinstance(form, list):
        return isinstance(value, list) and len(value) > 0 and all(has_form(each, form[0]) for each in value)
    return isinstance(value, int | type(form)) and not isinstance(value, bool)


def planner():
    from pathfinding.finder.a_star import AStarFinder

    return plans_with(AStarFinder())


def ida_planner():
    from pathfinding.finder.ida_star import IDAStarFinder

    return plans_with(IDAStarFinder())


def plans_with(finder):
    from pathfinding.core.grid import Grid

    state = {"map": [[1]]}

    def on_map(message):
        if len({len(row) for row in message["cells"]}) != 1:
            raise ValueError("rows of different lengths")
        state["map"] = message["cells"]

    def on_query(message):
        grid = Grid(matrix=state["map"])
        if not (grid.inside(message["x0"], message["y0"]) and grid.inside(message["x1"], message["y1"])):
            raise ValueError("not on the map")
        start, end = grid.node(message["x0"], message["y0"]), grid.node(message["x1"], message["y1"])
        path, runs = finder.find_path(start, end, grid)
        publish({"steps": len(path), "runs": runs})

    return {"map": on_map, "query": on_query}


def controller():
    from simple_pid import PID

    pid = PID(1.0, 0.5, 0.1, setpoint=20.0, sample_time=None, output_limits=(0.0, 100.0))

    def on_tuning(message):
        pid.setpoint = message["setpoint"]
        pid.tunings = message["kp"], message["ki"], message["kd"]
        pid.output_limits = message["low"], message["high"]

    def on_measured(message):
        publish({"output": pid(message["value"], dt=message["dt"])})

    return {"tuning": on_tuning, "measured": on_measured}


def tracker():
    import numpy as np
    from filterpy.kalman import KalmanFilter

    kalman = KalmanFilter(dim_x=2, dim_z=1)
    kalman.F, kalman.H = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    kalman.Q, kalman.P = 0.01 * np.eye(2), 10.0 * np.eye(2)

    def on_position(message):
        kalman.predict()
        kalman.update(message["z"], R=message["variance"])
        publish({"x": float(kalman.x[0, 0]), "v": float(kalman.x[1, 0]), "p": float(kalman.P[0, 0])})

    return {"position": on_position}


def unscented():
    import numpy as np
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    points = MerweScaledSigmaPoints(2, alpha=0.1, beta=2.0, kappa=1.0)
    ukf = UnscentedKalmanFilter(
        dim_x=2, dim_z=1, dt=0.1, points=points, fx=lambda x, dt: np.array([x[0] + dt * x[1], x[1]]), hx=lambda x: x[:1]
    )
    ukf.Q, ukf.P = 0.01 * np.eye(2), 10.0 * np.eye(2)

    def on_position(message):
        ukf.predict(dt=message["dt"])
        ukf.update(np.array([message["z"]]), R=message["variance"])
        publish({"x": float(ukf.x[0]), "v": float(ukf.x[1]), "p": float(ukf.P[0, 0])})

    return {"position": on_position}


def navigator():
    import pymap3d
    from pymap3d.vincenty import vdist

    home = {"lat": 0.0, "lon": 0.0, "alt": 0.0}

    def on_home(message):
        home.update(message)

    def on_fix(message):
        place, origin = ((each["lat"], each["lon"], each["alt"]) for each in (message, home))
        east, north, up = pymap3d.geodetic2enu(*place, *origin)
        back = pymap3d.enu2geodetic(east, north, up, *origin)
        distance, bearing = vdist(*origin[:2], *place[:2])
        values = zip(
            ("e", "n", "u", "lat", "lon", "d", "b"), (east, north, up, *back[:2], distance, bearing), strict=True
        )
        publish({name: float(value) for name, value in values})

    return {"home": on_home, "fix": on_fix}


def guarded(key, handle, sample):
    try:
        message = json.loads(sample.payload.to_bytes())
        if not has_form(message, FORMS[key]):
            raise ValueError("not of the form of this topic")
        handle(message)
    except ValueError as error:
        print(f"refused: {error}", file=sys.stderr, flush=True)


def publish(values):
    out.put(json.dumps(values))


KINDS = {each.__name__: each for each in (planner, ida_planner, controller, tracker, unscented, navigator)}
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
handlers = KINDS[KIND]()
session = zenoh.open(config)
out = session.declare_publisher("answer", congestion_control=zenoh.CongestionControl.BLOCK)
subscribers = [
    session.declare_subscriber(key, lambda sample, key=key, handle=handle: guarded(key, handle, sample))
    for key, handle in handlers.items()
]
threading.Event().wait()
