"""A node written with real rclpy, unmodified, is taken from its crash to the voltage that brings the system down."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import FieldsRecord, FindingRecord, MinimalRecord, RuleRecord
from tests.ros2_env import ros2_interpreter

pytestmark = [pytest.mark.e2e, pytest.mark.nightly, pytest.mark.timeout(3000)]

CHARGER = Path(__file__).resolve().parents[1] / "systems" / "charger" / "riot.toml"
LIMIT = 12.9
"""Volts from which on the estimator says 110 %."""


def test_an_rclpy_node_is_taken_through_the_whole_chain(riot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIOT_ROS_PYTHON", str(ros2_interpreter()))
    options = ("--trials", 30, "--jobs", 4, "--format", "json")
    done = riot("analyze", "--system", CHARGER, "--out", tmp_path, *options, timeout=2800)
    assert done.returncode == 1, done.stderr
    (found,) = json.loads(done.stdout)["findings"]
    folder = Path(found["finding"])
    finding = FindingRecord.load(folder)
    assert (finding.component, finding.monitor) == ("lamp", "crash")
    assert all("lamp.py" in line for line in finding.details)
    assert "on_state" in finding.signature
    assert len(MinimalRecord.load(folder).kept) == 1
    fields = {field.name: field.kind for field in FieldsRecord.load(folder).fields}
    assert fields["/battery_state:percentage"] == "exceptional"
    assert set(fields) <= {"/battery_state:percentage", "/battery_state:present"}
    rule = RuleRecord.load(folder)
    assert "/battery_state:percentage" in rule.text
    assert rule.balanced_accuracy >= 0.95
    assert "/battery_voltage:data" in PermeabilityRecord.load(folder).permeable
    activation = ActivationRecord.load(folder)
    assert activation.found is not None
    assert activation.found["/battery_voltage:data"] > LIMIT - 0.1
    assert activation.replays_failed >= 0.9 * activation.replays
    assert "lamp" in (folder / "report.html").read_text()

    again = riot("reproduce", folder)
    assert again.returncode == 1, again.stderr
    assert "still failing" in again.stdout
