"""What the libraries do without riot, as `riot test` has found it: prints one JSON object of facts."""

import json
import math
import signal
import warnings

import numpy as np
from filterpy.kalman import KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from pathfinding.core.grid import Grid
from pathfinding.finder.a_star import AStarFinder
from pathfinding.finder.ida_star import IDAStarFinder
from simple_pid import PID

warnings.simplefilter("ignore")
NOMINAL, ENDLESS_S = 30, 10


def controller(gain):
    pid = PID(1.5, 0.5, 0.1, setpoint=20.0, sample_time=None, output_limits=(0.0, 100.0))
    for ki in (0.5, gain, *[0.5] * NOMINAL):
        pid.tunings = 1.5, ki, 0.1
        output = pid(18.0, dt=0.1)
    return not math.isfinite(output)


def tracker(z, variance):
    kalman = KalmanFilter(dim_x=2, dim_z=1)
    kalman.F, kalman.H = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    kalman.Q, kalman.P = 0.01 * np.eye(2), 10.0 * np.eye(2)
    for position, noise in ((z, variance), *[(3.0, 0.5)] * NOMINAL):
        kalman.predict()
        kalman.update(position, R=noise)
    values = {"x": kalman.x[0, 0], "v": kalman.x[1, 0], "p": kalman.P[0, 0]}
    return sorted(name for name, value in values.items() if not math.isfinite(value))


def unscented(z, variance, dt):
    points = MerweScaledSigmaPoints(2, alpha=0.1, beta=2.0, kappa=1.0)
    ukf = UnscentedKalmanFilter(
        dim_x=2, dim_z=1, dt=0.1, points=points, fx=lambda x, dt: np.array([x[0] + dt * x[1], x[1]]), hx=lambda x: x[:1]
    )
    ukf.Q, ukf.P = 0.01 * np.eye(2), 10.0 * np.eye(2)
    nominal, answers = (3.0, 0.5, 0.1), []
    for position, noise, step in (*[nominal] * 3, (z, variance, dt), *[nominal] * NOMINAL):
        try:
            ukf.predict(dt=step)
            ukf.update(np.array([position]), R=noise)
            answers.append(True)
        except ValueError:
            answers.append(False)
    return not any(answers[4:])


def finds(finder, end, walls):
    grid = Grid(matrix=[[0 if (x, y) in walls else 1 for x in range(6)] for y in range(4)])
    signal.alarm(ENDLESS_S)
    try:
        return len(finder.find_path(grid.node(0, 0), grid.node(*end), grid)[0])
    except (IndexError, TimeoutError) as error:
        return type(error).__name__
    finally:
        signal.alarm(0)


def out_of_time(*_):
    raise TimeoutError


signal.signal(signal.SIGALRM, out_of_time)
ENCLOSED = {(4, 3), (4, 2), (5, 2)}
facts = {
    "the output stays NaN after one NaN": controller(math.nan),
    "not finite after a NaN position": tracker(math.nan, 0.5),
    "not finite after an infinite variance": tracker(3.0, math.inf),
    "no answers after an infinite variance": unscented(3.0, math.inf, 0.1),
    "no answers after a position of 1e300": unscented(1e300, 0.5, 0.1),
    "no answers after a step of 1e10": unscented(3.0, 0.5, 1e10),
    "A* from a place to itself": finds(AStarFinder(), (0, 0), set()),
    "A* to an enclosed place": finds(AStarFinder(), (5, 3), ENCLOSED),
    "IDA* from a place to itself": finds(IDAStarFinder(), (0, 0), set()),
    "IDA* to an enclosed place": finds(IDAStarFinder(), (5, 3), ENCLOSED),
}
print(json.dumps(facts))
