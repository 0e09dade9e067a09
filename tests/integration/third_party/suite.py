"""Tests of somebody else: two nodes of zenoh-ros2-sdk, one of which says how fast the other shall drive.

The working folder has the nodes, `planner.py` and `driver.py`, both `ros_node.py`. They only know what is in their
environment: the port that they are given is nobody's.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from typing import Any

NOBODYS_PORT = "1"
TWIST = "geometry_msgs/msg/Twist"
STILL = {"x": 0.0, "y": 0.0, "z": 0.0}


class Node:
    """A node in a process of its own."""

    def __init__(self, name: str) -> None:
        command = [sys.executable, f"{name}.py", NOBODYS_PORT, name, name]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.answer()

    def do(self, do: str, **arguments: Any) -> Any:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"do": do, "topic": "/cmd_vel", "type": TWIST, **arguments}) + "\n")
        self._process.stdin.flush()
        return self.answer()

    def answer(self) -> Any:
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()


def main() -> int:
    planner, driver = Node("planner"), Node("driver")
    try:
        driver.do("subscribe")
        planner.do("advertise")
        deadline = time.monotonic() + 60
        while driver.do("count") < 2 and time.monotonic() < deadline:
            planner.do("publish", messages=[{"linear": {"x": 1.5, "y": 0.0, "z": 0.0}, "angular": STILL}])
            time.sleep(0.05)
        speeds = [x for (x,) in driver.do("values", paths=["linear.x"])][:2]
    finally:
        planner.end()
        driver.end()
    print(speeds)
    return 0 if speeds and all(map(math.isfinite, speeds)) else 3


if __name__ == "__main__":
    sys.exit(main())
