"""A system that is different in kind (JSON, no ROS, a mode field, a hang) passes through the same chain."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import FieldsRecord, MinimalRecord, RuleRecord

pytestmark = [pytest.mark.e2e, pytest.mark.nightly, pytest.mark.timeout(1800)]

PRESS = Path(__file__).resolve().parents[1] / "systems" / "press" / "riot.toml"


def test_press_is_taken_from_a_hang_to_the_knob(riot, tmp_path: Path) -> None:
    done = riot("analyze", "--system", PRESS, "--out", tmp_path, "--trials", 40, "--format", "json", timeout=800)
    assert done.returncode == 1, done.stderr
    (found,) = json.loads(done.stdout)["findings"]
    folder = Path(found["finding"])
    assert folder.name.startswith("hang-drive")
    assert len(MinimalRecord.load(folder).kept) == 1
    fields = {field.name: field.kind for field in FieldsRecord.load(folder).fields}
    assert set(fields) == {"press/drive/command:speed", "press/drive/command:mode"}
    rule = RuleRecord.load(folder)
    assert "press/drive/command:mode == 'step'" in rule.text.replace('"', "'")
    assert rule.balanced_accuracy >= 0.99
    assert {"press/panel:knob", "press/panel:lever"} <= set(PermeabilityRecord.load(folder).permeable)
    activation = ActivationRecord.load(folder)
    assert activation.found is not None
    assert activation.found["press/panel:knob"] < 20
    assert activation.replays_failed >= 9


def test_a_log_of_the_panel_is_enough(riot, tmp_path: Path) -> None:
    for file in PRESS.parent.iterdir():
        if file.is_file():
            shutil.copy(file, tmp_path)
    done = riot("test", "--system", tmp_path / "riot.toml", "--out", tmp_path / "first", "--trials", 1, timeout=300)
    assert done.returncode in (0, 1), done.stderr
    shutil.copy(tmp_path / "first/nominal.mcap", tmp_path)
    text = (tmp_path / "riot.toml").read_text()
    begin, end = text.index("[components.panel]"), text.index("[components.governor]")
    alone = (text[:begin] + text[end:]).replace('"shop", "machine"]', '"machine"]\nnominal = "nominal.mcap"')
    (tmp_path / "riot.toml").write_text(alone)
    options = ("--trials", 40, "--format", "json")
    done = riot("analyze", "--system", tmp_path / "riot.toml", "--out", tmp_path / "out", *options, timeout=1400)
    assert done.returncode == 1, done.stderr
    (found,) = json.loads(done.stdout)["findings"]
    permeability, activation = (
        record.load(Path(found["finding"])) for record in (PermeabilityRecord, ActivationRecord)
    )
    assert set(permeability.permeable) == {"press/panel:knob", "press/panel:lever"}  # the lever decides on the mode
    assert activation.found is not None
    assert activation.found["press/panel:knob"] < 20
    assert (activation.replays_failed, activation.controls_failed) == (activation.replays, 0)
    assert permeability.played
    assert activation.played
