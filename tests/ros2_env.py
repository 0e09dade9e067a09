"""Real ROS 2 for tests: rclpy from wheels, in an environment of its own.

`tests/interop.py` provides it.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.interop import ROS2, require


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
        domain: Of `riot_bus.processes.ros_domains.free_domains`, so that nobody else uses it.
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
