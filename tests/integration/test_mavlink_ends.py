"""Ground stations and autopilots of others, through the bridge and without it: what they see is the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.integration.mavlink_ends.stand import BETWEEN, PATIENCE, Stand, losses
from tests.mavlink_env import mavlink_python
from tests.tiers import chosen

__all__ = ["mavlink_python"]
GATE = ("own router, intercepted",)
pytestmark = [pytest.mark.integration, pytest.mark.parametrize("between", chosen(BETWEEN, gate=GATE))]

ROUTE = [[16, 0, 47.397742, 8.545594, 488.0], [22, 3, 47.397742, 8.545594, 20.0], [16, 3, 47.398242, 8.545594, 25.0]]


def test_mavproxy(mavlink_python: Path, tmp_path: Path, between: str) -> None:
    with Stand(mavlink_python, tmp_path, between) as stand:
        autopilot = stand.autopilot()
        assert stand.report("mavproxy_ground.py", stand.ground) == {
            "system": "1",
            "parameters": "32",
            "set": True,
            "mission": ROUTE,
            "climbs": True,
            "lost": "0",
            "tracebacks": [],
        }
        ((source, (received, lost)),) = losses(autopilot).items()
        assert (source, received > 10, lost) == ("255/230", True, 0)
        check_bridge(stand, between, lost=0)


def test_dronekit(mavlink_python: Path, tmp_path: Path, between: str) -> None:
    with Stand(mavlink_python, tmp_path, between) as stand:
        autopilot = stand.autopilot()
        report = stand.report("dronekit_ground.py", stand.ground)
        assert round(report.pop("altitude")) == 488
        route = [
            [*each[:2], pytest.approx(each[2], abs=2e-6), pytest.approx(each[3], abs=2e-6), each[4]] for each in ROUTE
        ]
        assert report == {
            "parameters": 32,
            "satellites": 14,
            "version": 4,
            "set": True,
            "mission": route[1:],  # it leaves out the first item, which is home
            "armed": True,
            "in_air": True,
            "moves": True,
            "mode": "LAND",
            "lost": 0,
        }
        ((_, (received, lost)),) = losses(autopilot).items()
        assert received > 10
        check_bridge(stand, between, lost=lost)  # two of its threads may take the same number, also without a bridge


def test_mavsdk_on_the_ground(mavlink_python: Path, tmp_path: Path, between: str) -> None:
    with Stand(mavlink_python, tmp_path, between) as stand:
        autopilot = stand.autopilot()
        report = stand.report("mavsdk_ground.py", stand.ground.replace("udpin:", "udpin://"))
        assert round(report.pop("altitude")) == 488
        assert report == {
            "connection": "0",
            "system": [1, True, "ARDUPILOT"],
            "satellites": 14,
            "parameters": 32,
            "set": [2000, 250.0],
            "mission": [[*each[:2], round(each[2] * 1e7), round(each[3] * 1e7), each[4]] for each in ROUTE],
            "armed": True,
            "in_air": True,
            "progress": 3,
            "mode": "LAND",
        }
        ((source, (received, lost)),) = losses(autopilot).items()
        assert (source, received > 10) == ("245/190", True)
        check_bridge(stand, between, lost=lost)  # mavsdk itself leaves out a few numbers


def test_mavsdk_in_the_air(mavlink_python: Path, tmp_path: Path, between: str) -> None:
    with Stand(mavlink_python, tmp_path, between) as stand:
        station = stand.start("-m", "drone.station", f"--connect={stand.ground}", "--fly", "--duration=40")
        autopilot = stand.start(
            str(Path(__file__).parent / "mavlink_ends/mavsdk_autopilot.py"), stand.air.replace("udpout:", "udpout://")
        )
        assert station.stdout is not None
        lines = iter(station.stdout.readline, "")
        assert any(line.rstrip().endswith("armed") for line in lines)
        out, err = autopilot.communicate("", timeout=PATIENCE)
        assert autopilot.returncode == 0, out + err
        told: dict[str, Any] = json.loads(out.splitlines()[-1])
        assert told["armed"][:1] == [True]
        assert told["missions"][:1] == [6]
        received, lost = losses(station)["1/1"]
        assert (received > 5, lost) == (True, 0)
        check_bridge(stand, between, lost=0)


def check_bridge(stand: Stand, between: str, *, lost: int) -> None:
    """Nothing was lost within the bridge, and as much before it as the autopilot has missed."""
    if between == "nothing":
        return
    status = stand.status()
    air, ground = status["links"]["air"], status["links"]["ground"]
    assert (air["in"], ground["in"]) == (ground["out"], air["out"])
    counts = [each.get(what, 0) for each in (air, ground) for what in ("lost_out", "bad_crc", "dropped_packets")]
    assert counts == [0] * 6
    assert {name: source["lost"] for name, source in air["sources"].items()} == {"1/1": 0}
    assert sum(source["lost"] for source in ground["sources"].values()) == lost
    assert status["problems"] == []
