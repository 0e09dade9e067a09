"""A loop through the simulator, an input that hides its neighbours, and another failure: each is told as it is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import FindingRecord, RuleRecord

pytestmark = [pytest.mark.e2e, pytest.mark.nightly, pytest.mark.timeout(1200)]

LOOP = Path(__file__).resolve().parents[1] / "systems" / "loop" / "riot.toml"


def test_a_closed_loop_with_a_field_that_is_refused_and_another_failure(riot, tmp_path: Path) -> None:
    done = riot("analyze", "--system", LOOP, "--out", tmp_path, "--trials", 60, "--format", "json", timeout=1100)
    assert done.returncode == 1, done.stderr
    folders = [Path(each["finding"]) for each in json.loads(done.stdout)["findings"]]
    (folder,) = (each for each in folders if "RuntimeError" in FindingRecord.load(each).signature)
    assert RuleRecord.load(folder).text.startswith("loop/command:speed > ")

    permeability = PermeabilityRecord.load(folder)
    assert permeability.pruned == ()
    assert set(permeability.permeable) == {"loop/goal:x", "loop/pose:x"}
    assert {name for name, why in permeability.untested.items() if "as if it was refused" in why} == {
        "loop/pose:w",
        "loop/pose:z",
    }
    activation = ActivationRecord.load(folder)
    assert activation.found is not None
    assert (activation.replays_failed, activation.controls_failed) == (activation.replays, 0)
    assert any("ValueError" in signature or "backwards" in signature for signature in activation.others)
