"""Libraries of others, one behind the other: a fault of the planner is reached from GPS fixes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import FindingRecord, RuleRecord
from tests.interop import LIBRARIES, require

pytestmark = [pytest.mark.e2e, pytest.mark.nightly, pytest.mark.timeout(1200)]

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "localisation"
BASE = {"gps:lat": 47.3977, "gps:lon": 8.5456}


def test_a_fault_of_the_planner_is_reached_from_gps(riot, tmp_path: Path) -> None:
    python = str(require(LIBRARIES))
    for name in ("riot.toml", "node.py"):
        (tmp_path / name).write_text((EXAMPLE / name).read_text().replace("{python}", python))
    options = ("--out", tmp_path / "out", "--trials", 60, "--format", "json")
    done = riot("analyze", "--system", tmp_path / "riot.toml", *options, timeout=1100)
    assert done.returncode == 1, done.stderr
    folders = [Path(each["finding"]) for each in json.loads(done.stdout)["findings"]]
    (folder,) = (each for each in folders if "start = grid.node" in FindingRecord.load(each).signature)
    rule = RuleRecord.load(folder)
    assert rule.balanced_accuracy is not None
    assert rule.balanced_accuracy >= 0.95
    assert set(PermeabilityRecord.load(folder).permeable) == set(BASE)
    activation = ActivationRecord.load(folder)
    assert activation.found is not None
    assert activation.found.keys() <= BASE.keys()
    assert all(abs(float(value) - BASE[name]) > 0.0005 for name, value in activation.found.items())
    assert activation.replays_failed >= 9
    assert activation.controls_failed == 0
