"""The nodes of the loop: `node.py operator|sim|planner|motor ENDPOINT [SEED SECONDS]`.

The operator says where to go, the planner turns the way from the pose to there into a command, the simulator moves by
it and tells the next pose, and the motor, which is the unit, dies of commands above 100; below -300 it dies in another
way. The planner refuses poses whose attitude (w, z) is no unit quaternion.
"""

import json
import math
import random
import sys
import threading
import time

import zenoh

ROLE, ENDPOINT = sys.argv[1:3]
RATE = 100.0
FASTEST, BACKWARDS = 100.0, -300.0


def connect():
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{ENDPOINT}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    return zenoh.open(config)


def number(said, name):
    """Return a number of a message; None if it has none."""
    value = said.get(name) if isinstance(said, dict) else None
    return None if isinstance(value, bool) or not isinstance(value, (int, float)) else float(value)


def read(sample):
    try:
        return json.loads(sample.payload.to_bytes())
    except ValueError:
        return None


def tell(session, key, say):
    """Publish what `say` returns, so many times a second, once somebody listens."""
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    listened = threading.Event()
    listener = publisher.declare_matching_listener(lambda status: listened.set() if status.matching else None)
    if publisher.matching_status.matching:
        listened.set()
    listened.wait(5)
    start = time.monotonic()
    for tick in range(int(float(sys.argv[4]) * RATE)):
        time.sleep(max(0.0, start + tick / RATE - time.monotonic()))
        publisher.put(json.dumps(say(tick)))
    listener.undeclare()


def operator(session):
    noise = random.Random(int(sys.argv[3]))
    goal = 0.0

    def say(tick):
        nonlocal goal
        goal = noise.uniform(-20, 20) if tick % 25 == 0 else goal
        return {"x": goal}

    tell(session, "loop/goal", say)


def sim(session):
    speed = place = 0.0

    def move(sample):
        nonlocal speed
        speed = number(read(sample), "speed") or 0.0

    def say(_):
        nonlocal place
        place += speed / RATE
        return {"x": place, "w": 1.0, "z": 0.0}

    with session.declare_subscriber("loop/command", move):
        tell(session, "loop/pose", say)


def planner(session):
    goal = 0.0
    commands = session.declare_publisher("loop/command", congestion_control=zenoh.CongestionControl.BLOCK)
    with session.declare_subscriber("loop/*", zenoh.handlers.FifoChannel(1000)) as inbox:
        for sample in inbox:
            said, key = read(sample), str(sample.key_expr)
            place = number(said, "x")
            if place is None:
                continue
            if key == "loop/goal":
                goal = place
            elif key == "loop/pose":
                w, z = number(said, "w"), number(said, "z")
                if w is not None and z is not None and abs(math.hypot(w, z) - 1) < 0.01:
                    commands.put(json.dumps({"speed": 2 * (goal - place)}))


def motor(session):
    with session.declare_subscriber("loop/command", zenoh.handlers.FifoChannel(1000)) as inbox:
        for sample in inbox:
            speed = number(read(sample), "speed")
            if speed is None:
                continue
            if speed > FASTEST:
                raise RuntimeError(f"{speed} is too fast")
            if speed < BACKWARDS:
                raise ValueError(f"{speed} is backwards")


with connect() as session:
    {"operator": operator, "sim": sim, "planner": planner, "motor": motor}[ROLE](session)
