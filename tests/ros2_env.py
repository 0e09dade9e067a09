"""Real ROS 2 for tests: rclpy from wheels, in an environment of its own, and DDS domains that no other test uses.

The wheels change how every Python of their environment starts, so they cannot live beside riot_bus. The environment is
made once per user and kept in the cache folder; whoever needs it first makes it, others wait for it.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGES = (
    "ros-rclpy[fastrtps]==9.1.2",
    "ros-std-msgs",
    "ros-sensor-msgs",
    "ros-nav-msgs",
    "ros-std-srvs",
    "ros-test-msgs",
    "numpy>=1.26",
)
PYTHONS = ("3.11", "3.12")
"""Versions that there are wheels for."""
IMPORTS = "import rclpy, nav_msgs.msg, sensor_msgs.msg, std_srvs.srv, test_msgs.action"
INSTALL_S = 400
FIRST_DOMAIN, LAST_DOMAIN = 1, 99  # their UDP ports are below those that the system gives away


@pytest.fixture(scope="session")
def ros2_python() -> Path:
    """An interpreter that has rclpy; import this fixture, or call `ros2_interpreter`."""
    return ros2_interpreter()


@functools.cache
def ros2_interpreter() -> Path:
    """Return an interpreter that has rclpy with Fast DDS and common messages; skips the test if there is none."""
    interpreter, problem = install()
    if interpreter is None:
        pytest.skip(f"ROS 2 cannot be installed: {problem}")
    return interpreter


def ros2_environment(domain: int, folder: Path) -> dict[str, str]:
    """Return the variables of a process that uses ROS 2 in one domain, on this machine alone.

    Args:
        domain: Of `ros2_domains`.
        folder: For its log files.
    """
    foreign = ("ROS_", "RMW_", "FASTDDS_", "FASTRTPS_", "RCUTILS_", "AMENT_", "ZENOH_", "RIOT_", "PYTHON", "_ROS_")
    kept = {key: value for key, value in os.environ.items() if not key.startswith(foreign)}
    return {
        **kept,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder),
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",  # processes that are killed leave nothing in shared memory
        "PYTHONUNBUFFERED": "1",
    }


@contextlib.contextmanager
def ros2_domains(count: int) -> Iterator[list[int]]:
    """Reserve domains that no other test of this machine uses meanwhile."""
    folder = _own_folder(Path(tempfile.gettempdir()) / f"riot-bus-domains-{os.getuid()}")
    numbers = list(range(FIRST_DOMAIN, LAST_DOMAIN + 1))
    random.shuffle(numbers)
    with contextlib.ExitStack() as stack:
        found: list[int] = []
        for number in numbers:
            lock = stack.enter_context((folder / str(number)).open("w"))
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            found.append(number)
            if len(found) == count:
                break
        assert len(found) == count, "all DDS domains are in use"
        yield found


def cache_folder(name: str, *contents: str) -> Path:
    """Return this user's folder for something that tests install once.

    Args:
        name: What it is.
        contents: What makes it another one.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "riot-bus-tests"
    return _own_folder(cache / f"{name}-{hashlib.sha256(repr(contents).encode()).hexdigest()[:12]}")


@functools.cache
def install() -> tuple[Path | None, str]:
    """Return the interpreter, else why there is none; processes take turns."""
    base = next(filter(None, map(_python, PYTHONS)), None)
    if base is None:
        return None, f"needs Python {' or '.join(PYTHONS)}"
    try:
        folder = cache_folder("ros2", base, *PACKAGES)
    except OSError as error:
        return None, str(error)
    interpreter, complete = folder / "venv/bin/python", folder / "complete"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if complete.exists() and interpreter.exists():
            return interpreter, ""
        pip = [str(interpreter), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--retries=1"]
        for command in (
            [base, "-m", "venv", "--clear", str(folder / "venv")],
            [*pip, "--prefer-binary", *PACKAGES],
            [str(interpreter), "-c", IMPORTS],
        ):
            problem = _run(command, folder)
            if problem:
                return None, problem
        complete.touch()
    return interpreter, ""


def _run(command: list[str], folder: Path) -> str:
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=INSTALL_S,
            check=False,
            env=ros2_environment(0, folder),
        )
    except (subprocess.TimeoutExpired, OSError) as error:
        return f"{' '.join(command[1:4])}: {error}"
    if not done.returncode:
        return ""
    lines = [line for line in (done.stdout + done.stderr).splitlines() if not line.startswith("WARNING")]
    return f"{' '.join(command[1:4])}: {lines[-1] if lines else done.returncode}"


def _python(version: str) -> str | None:
    if sys.version_info[:2] == tuple(map(int, version.split("."))):
        return os.path.realpath(sys.executable)  # the same from each environment, so that one installation is enough
    return shutil.which(f"python{version}")


def _own_folder(folder: Path) -> Path:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        raise PermissionError(f"{folder} belongs to somebody else")
    return folder
