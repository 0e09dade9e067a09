"""Programs that speak MAVLink as units: an unmodified MAVProxy, mavsdk, and the drone of the example."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import FieldsRecord, FindingRecord, MinimalRecord, RuleRecord
from tests.mavlink_env import mavlink_python

__all__ = ["mavlink_python"]
pytestmark = [pytest.mark.e2e, pytest.mark.nightly, pytest.mark.timeout(3600)]

ROOT = Path(__file__).resolve().parents[2]
SYSTEMS = ROOT / "tests/systems"
LAT, LON = "mavlink_raw/air/1/1/GLOBAL_POSITION_INT:lat", "mavlink_raw/air/1/1/GLOBAL_POSITION_INT:lon"


@pytest.mark.timeout(7200)
def test_mavproxy_has_faults_that_rules_explain(
    riot, tmp_path: Path, mavlink_python: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIOT_MAVLINK_PYTHON", str(mavlink_python))
    system = SYSTEMS / "mavproxy/riot.toml"
    options = ("--trials", 100_000, "--seconds", 600)
    done = riot("test", "--system", system, "--out", tmp_path, *options, timeout=1500)
    assert done.returncode == 1, done.stderr
    folders = sorted((tmp_path / "findings").iterdir())
    found = [FindingRecord.load(folder) for folder in folders]
    assert len({each.signature for each in found if each.monitor == "crash"}) >= 2

    done = riot("analyze", "--system", system, "--out", tmp_path, timeout=5400)
    assert done.returncode == 1, done.stderr
    rules = [RuleRecord.load(folder) for folder in folders if RuleRecord.exists(folder)]
    explained = [rule for rule in rules if (rule.balanced_accuracy or 0) >= 0.95]
    assert len(explained) >= 2, done.stdout


def test_mavsdk_has_none(riot, tmp_path: Path, mavlink_python: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIOT_MAVLINK_PYTHON", str(mavlink_python))
    options = ("--trials", 5000)
    done = riot("test", "--system", SYSTEMS / "mavsdk/riot.toml", "--out", tmp_path, *options, timeout=3500)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_fault_behind_ros_2_comes_from_mavlink(riot, tmp_path: Path) -> None:
    system = ROOT / "examples/mavlink/riot.toml"
    options = ("--unit", "advisor", "--trials", 30, "--format", "json")
    done = riot("analyze", "--system", system, "--out", tmp_path, *options, timeout=3000)
    assert done.returncode == 1, done.stderr
    (found,) = json.loads(done.stdout)["findings"]
    folder = Path(found["finding"])
    assert FindingRecord.load(folder).signature.startswith("crash in advisor")
    assert len(MinimalRecord.load(folder).kept) == 1
    fields = {field.name for field in FieldsRecord.load(folder).fields}
    assert fields & {"/drone/fix:latitude", "/drone/fix:longitude"}
    assert fields <= {"/drone/fix:latitude", "/drone/fix:longitude", "/drone/fix:altitude"}
    rule = RuleRecord.load(folder)
    assert rule.balanced_accuracy >= 0.95
    assert {LAT, LON} & set(PermeabilityRecord.load(folder).permeable)
    activation = ActivationRecord.load(folder)
    assert activation.found is not None
    assert activation.found.get(LAT, 0) > 474_299_000 or activation.found.get(LON, 0) > 85_699_000
    assert activation.replays_failed >= 0.9 * activation.replays
    assert activation.region is not None
    assert {each.field for each in activation.region.ranges} & {LAT, LON} & _moved(activation)


def _moved(activation: ActivationRecord) -> set[str]:
    """Return those of the fields of the place that are outside of the tile."""
    found = activation.found or {}
    return {name for name, edge in ((LAT, 474_299_000), (LON, 85_699_000)) if found.get(name, 0) > edge}
