"""The unit: moves in whole steps, and never arrives when a step is smaller than one."""

import json

import zenoh
from link import connect

STROKE = 12
MODES = ("hold", "step", "home")


def strokes(mode, speed):
    """Return how many steps a stroke takes."""
    if mode != "step":
        return 0
    position = count = 0
    while position < STROKE:
        position += int(speed)
        count += 1
    return count


def understood(command):
    """Return mode and speed; everything is checked but the one thing that matters."""
    mode, speed = command.get("mode"), command.get("speed")
    if mode not in MODES or isinstance(speed, bool) or not isinstance(speed, (int, float)) or speed != speed:
        return "hold", 1.0
    return mode, max(-1000.0, min(1000.0, speed))


def main():
    queue = zenoh.handlers.FifoChannel(1000)
    with connect() as session, session.declare_subscriber("press/drive/command", queue) as inbox:
        done = session.declare_publisher("press/drive/state")
        for sample in inbox:
            try:
                command = json.loads(sample.payload.to_bytes())
            except ValueError:
                continue
            if isinstance(command, dict):
                done.put(json.dumps({"steps": strokes(*understood(command))}))


if __name__ == "__main__":
    main()
