"""Real ROS 2 for tests: rclpy from wheels, in an environment of its own, and DDS domains that no other test uses.

`tests/interop.py` provides it.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import random
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.interop import ROS2, own_folder, require

FIRST_DOMAIN, LAST_DOMAIN = 1, 99  # their UDP ports are below those that the system gives away


@pytest.fixture(scope="session")
def ros2_python() -> Path:
    """An interpreter that has rclpy; import this fixture, or call `ros2_interpreter`."""
    return ros2_interpreter()


def ros2_interpreter() -> Path:
    """Return an interpreter that has rclpy with Fast DDS and common messages; skips the test if there is none."""
    return require(ROS2)


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
    folder = own_folder(Path(tempfile.gettempdir()) / f"riot-bus-domains-{os.getuid()}")
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
