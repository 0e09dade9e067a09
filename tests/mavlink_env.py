"""MAVLink programs of others for tests: MAVProxy, mavsdk and dronekit, in an environment of their own.

`tests/interop.py` provides it.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.interop import MAVLINK, require

DRONE = Path(__file__).parents[1] / "examples/mavlink"
"""Where the example's package `drone` is."""


@pytest.fixture(scope="session")
def mavlink_python() -> Path:
    """An interpreter that has these programs; skips the test if there is none."""
    return require(MAVLINK)


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
