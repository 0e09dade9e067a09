"""The nodes of the pump: `node.py dial|filter|exit|silent|crash:PROBABILITY ENDPOINT [SECONDS]`.

The dial publishes a level, the filter halves it, and the pump, which is the unit, answers each command with its state,
until one is above 100: then it ends, or falls silent for ever, or crashes with a probability.
"""

import json
import os
import sys
import threading
import time

import zenoh

ROLE, ENDPOINT = sys.argv[1:3]
RATE = 100.0
HIGHEST = 100.0


def connect():
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{ENDPOINT}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    return zenoh.open(config)


def dial(session):
    publisher = session.declare_publisher("pump/dial", congestion_control=zenoh.CongestionControl.BLOCK)
    listened = threading.Event()
    listener = publisher.declare_matching_listener(lambda status: listened.set() if status.matching else None)
    if publisher.matching_status.matching:
        listened.set()
    listened.wait(5)
    start = time.monotonic()
    for tick in range(int(float(sys.argv[3]) * RATE)):
        time.sleep(max(0.0, start + tick / RATE - time.monotonic()))
        publisher.put(json.dumps({"level": 50.0 + tick % 7}))
    listener.undeclare()


def answers(session, asked, told, answer):
    """Answer each message of a topic; end when `answer` says so by None."""
    publisher = session.declare_publisher(told, congestion_control=zenoh.CongestionControl.BLOCK)
    with session.declare_subscriber(asked, zenoh.handlers.FifoChannel(1000)) as inbox:
        for sample in inbox:
            try:
                said = json.loads(sample.payload.to_bytes())
            except ValueError:
                continue
            level = said.get("level") if isinstance(said, dict) else None
            if isinstance(level, bool) or not isinstance(level, (int, float)):
                continue
            made = answer(level)
            if made is None:
                return
            if made:
                publisher.put(json.dumps(made))


def pump():
    broken = False

    def answer(level):
        nonlocal broken
        if ROLE.startswith("crash:") and level > HIGHEST:
            # Not of `random`, whose state is the same in processes that were forked.
            if int.from_bytes(os.urandom(4)) < float(ROLE.removeprefix("crash:")) * 2**32:
                raise ValueError("above the highest level")
            return {"flow": level}
        broken = broken or level > HIGHEST
        return {"flow": level} if not broken else None if ROLE == "exit" else {}

    return answer


with connect() as session:
    if ROLE == "dial":
        dial(session)
    elif ROLE == "filter":
        answers(session, "pump/dial", "pump/command", lambda level: {"level": level / 2})
    else:
        answers(session, "pump/command", "pump/state", pump())
