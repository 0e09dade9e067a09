"""A test suite of somebody else, for `riot ros-test`: plain pytest and two programs that use Zenoh."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.integration.router_process import riot

__all__ = ["PYTEST", "ros_test", "write_suite"]

PYTEST = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir=.", "-c", os.devnull]

LISTENER = """
import json, sys, zenoh
session = zenoh.open(zenoh.Config.from_env())
poses = session.declare_subscriber("pose")
print("ready", flush=True)
for _ in range(3):
    print(json.loads(poses.recv().payload.to_bytes())["x"], flush=True)
"""
TALKER = """
import json, time, zenoh
session = zenoh.open(zenoh.Config.from_env())
publisher = session.declare_publisher("pose")
for number in range(1000):
    publisher.put(json.dumps({"x": number + 0.5}), encoding="application/json")
    time.sleep(0.02)
"""
TESTS = """
import math, subprocess, sys

def test_poses_are_finite():
    with subprocess.Popen([sys.executable, "listener.py"], stdout=subprocess.PIPE, text=True) as listener:
        assert listener.stdout.readline() == "ready\\n"
        with subprocess.Popen([sys.executable, "talker.py"]) as talker:
            values = [float(listener.stdout.readline()) for _ in range(3)]
            talker.kill()
    assert all(map(math.isfinite, values)), values
"""


def write_suite(folder: Path, *, config: str = "zenoh.Config.from_env()") -> None:
    """Write the suite into a folder, as `test_poses.py` and what it starts.

    Args:
        folder: Target folder.
        config: Expression for the configuration of the programs' sessions.
    """
    for name, text in {"listener": LISTENER, "talker": TALKER, "test_poses": TESTS}.items():
        (folder / f"{name}.py").write_text(text.replace("zenoh.Config.from_env()", config), encoding="utf-8")


def ros_test(
    folder: Path, *options: str, command: Sequence[str] = PYTEST, **environment: str
) -> tuple[int, str, list[str]]:
    """Run `riot ros-test` in a folder; return exit status, stdout, and what riot says."""
    code, out, err = riot("ros-test", *options, "--", *command, cwd=folder, environment=environment)
    return code, out, [line.removeprefix("riot: ") for line in err.splitlines() if line.startswith("riot: ")]
