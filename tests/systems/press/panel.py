"""The operator's panel: a knob, a lever, and a thermometer that nobody reads."""

import json
import random
import sys
import threading
import time

import zenoh
from link import connect

SECONDS, SEED = float(sys.argv[2]), int(sys.argv[3])
RATE = 200.0

noise = random.Random(SEED)
with connect() as session:
    publisher = session.declare_publisher("press/panel", congestion_control=zenoh.CongestionControl.BLOCK)
    listened = threading.Event()
    listener = publisher.declare_matching_listener(lambda status: listened.set() if status.matching else None)
    if publisher.matching_status.matching:
        listened.set()
    listened.wait(5)
    start = time.monotonic()
    for tick in range(int(SECONDS * RATE)):
        time.sleep(max(0.0, start + tick / RATE - time.monotonic()))
        reading = {
            "stamp": tick / RATE,
            "knob": 60 + noise.uniform(-20, 20),
            "lever": noise.uniform(0.55, 1.0),
            "oil": {"temperature": 40 + noise.gauss(0, 2), "pressure": 2.0 + noise.gauss(0, 0.1)},
        }
        publisher.put(json.dumps(reading))
    listener.undeclare()
