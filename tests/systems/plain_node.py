"""A node of a plain Zenoh system: `plain_node.py ROLE [--connect ENDPOINT | --config FILE]`, or `PLAIN_CONNECT`.

`sim` plays the world, `planner` and `arm` act on messages. It prints `ready` when it has declared all.
"""

import argparse
import json
import os
import struct
import threading
import time

import zenoh

parser = argparse.ArgumentParser()
parser.add_argument("role")
parser.add_argument("--connect", default=os.environ.get("PLAIN_CONNECT"))
parser.add_argument("--config")
arguments = parser.parse_args()
config = zenoh.Config.from_file(arguments.config) if arguments.config else zenoh.Config()
if arguments.connect:
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([arguments.connect]))
config.insert_json5("scouting/multicast/enabled", "false")
if os.environ.get("PLAIN_STAMPS"):
    config.insert_json5("timestamping/enabled", "true")
session = zenoh.open(config)


def plan(sample):
    pose = json.loads(sample.payload.to_bytes())
    if pose["x"] > 1e6:
        raise SystemExit("no way so far")
    speed = min(1.0, abs(pose["x"]))
    session.put("plan/cmd", b"\xa1\x61v" + struct.pack(">Bd", 0xFB, speed))  # CBOR, though nothing says so


def simulate():
    count = 0
    while True:
        count += 1
        for number in (1, 2):
            pose = json.dumps({"x": 0.01 * count * number, "n": count})
            session.put(f"robot/{number}/pose", pose, encoding="application/json")
        session.put("imu/raw", struct.pack("<Iff", count, 0.5, 9.81))
        time.sleep(0.02)


if arguments.role == "planner":
    keep = session.declare_subscriber("robot/*/pose", plan)
elif arguments.role == "arm":
    keep = [session.declare_subscriber(key, lambda sample: None) for key in ("plan/cmd", "imu/raw")]
print("ready", flush=True)
if arguments.role == "sim":
    simulate()
threading.Event().wait()
