"""MAVLink programs of others for tests: MAVProxy, mavsdk and dronekit, in an environment of their own.

The environment is made once per user and kept in the cache folder; whoever needs it first makes it, others wait.
"""

from __future__ import annotations

import fcntl
import functools
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros2_env import cache_folder

PACKAGES = ("MAVProxy==1.8.75", "mavsdk==4.1.0", "dronekit==2.9.2", "pymavlink==2.4.50", "future>=1.0")
IMPORTS = "import MAVProxy, mavsdk, pymavlink, past"
INSTALL_S = 500
DRONE = Path(__file__).parents[1] / "examples/mavlink"
"""Where the example's package `drone` is."""


@pytest.fixture(scope="session")
def mavlink_python() -> Path:
    """An interpreter that has these programs; skips the test if there is none."""
    interpreter, problem = install()
    if interpreter is None:
        pytest.skip(f"MAVProxy, mavsdk and dronekit cannot be installed: {problem}")
    return interpreter


def mavlink_environment(folder: Path) -> dict[str, str]:
    """Return the variables of such a program, whose files go to a folder; the example can be imported."""
    foreign = ("MAV", "RIOT_", "ZENOH_", "PYTHON")
    kept = {key: value for key, value in os.environ.items() if not key.startswith(foreign)}
    return {
        **kept,
        "HOME": str(folder),
        "PYTHONPATH": str(DRONE),
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONUNBUFFERED": "1",
    }


@functools.cache
def install() -> tuple[Path | None, str]:
    """Return the interpreter, else why there is none; processes take turns."""
    try:
        folder = cache_folder("mavlink", sys.version.partition(" ")[0], *PACKAGES)
    except OSError as error:
        return None, str(error)
    interpreter, complete = folder / "venv/bin/python", folder / "complete"
    pip = [str(interpreter), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--retries=1"]
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if complete.exists() and interpreter.exists():
            return interpreter, ""
        for command in (
            [sys.executable, "-m", "venv", "--clear", str(folder / "venv")],
            [*pip, "--prefer-binary", *PACKAGES],
            [str(interpreter), "-c", IMPORTS],
        ):
            problem = _run(command)
            if problem:
                return None, problem
        complete.touch()
    return interpreter, ""


def _run(command: list[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_S, check=False)
    except (subprocess.TimeoutExpired, OSError) as error:
        return f"{' '.join(command[1:4])}: {error}"
    lines = [line for line in (done.stdout + done.stderr).splitlines() if not line.startswith("WARNING")]
    return f"{' '.join(command[1:4])}: {lines[-1] if lines else done.returncode}" if done.returncode else ""
