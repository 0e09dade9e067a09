"""Failures that only nominal runs tell are made to happen from outside the system: real processes on a real bus."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps.reproduce import reproduce
from riot_bus.chain.whole import replay
from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.permeability import EdgeRecord, PermeabilityRecord
from riot_bus.findings.records import FieldsRecord, FindingRecord, ProportionRecord, RuleRecord
from riot_bus.findings.steps import ACTIVATE
from riot_bus.generalize.rules import Variable, learn_rule
from tests.tiers import chosen

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

PUMP = Path(__file__).parents[1] / "systems/pump"
LEVEL, DIAL = "pump/command:level", "pump/dial:level"
SIGNATURES = {"exit": "exit of pump: status 0", "silent": "silent of pump: nothing on pump/state"}


def write(folder: Path, fault: str) -> Path:
    """Copy the pump into a folder; return its riot.toml. With one fault the dial does not end by itself."""
    shutil.copy(PUMP / "node.py", folder)
    path = folder / "riot.toml"
    text = (PUMP / "riot.toml").read_text().replace("FAULT", fault)
    if fault == "silent":
        text = text.replace('"{duration}"', '"1000"') + "mined = false\n"  # once is enough
    path.write_text(text)
    return path


def find(workspace: Workspace, fault: str) -> Path:
    """Write what the steps before activation find out: the pump fails on levels above 100, which the dial reaches."""
    folder = workspace.findings / fault
    folder.mkdir(parents=True)
    FindingRecord(
        id=fault,
        system="pump",
        system_file=str(workspace.context.file.path),
        unit="pump",
        component="pump",
        monitor=fault,
        signature=SIGNATURES[fault],
    ).save(folder)
    variable = Variable(LEVEL, "float64", 200.0, passing=(25.0,), nominal=(25.0, 28.0), dictionary=())
    learned = learn_rule([variable], lambda asked: [one[LEVEL] > 100 for one in asked], seed=0, budget=40, validation=4)
    sure = ProportionRecord(value=1, low=0.9, high=1, count=10, total=10)
    FieldsRecord(fields=(), considered=(LEVEL,), bound=0.2, straight=12).save(folder)
    RuleRecord(
        text="",
        rule=learned.rule.to_dict(),
        python="",
        precision=sure,
        recall=sure,
        balanced_accuracy=1,
        scale={LEVEL: 1.0},
    ).save(folder)
    edge = EdgeRecord(
        external=DIAL, internal=LEVEL, permeable=True, strength=0.9, low=0.8, high=1, lag_s=0, p_value=0.01
    )
    PermeabilityRecord(edges=(edge,), runs=8).save(folder)
    return folder


@pytest.mark.parametrize("fault", chosen(SIGNATURES, gate=("exit",)))
def test_a_unit_that_ends_or_falls_silent_does_so_in_the_whole_system(
    tmp_path: Path, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replay, "_REPLAYS", 1)
    with Workspace(write(tmp_path, fault), tmp_path / "out", jobs=2) as workspace:
        folder, pace = find(workspace, fault), workspace.context.file.system.trial_run
        nominal = workspace.runners.in_system("pump", lambda: workspace.unit_log("pump"), pace, ())
        assert (nominal.trials, nominal.alarms, nominal.mute) == (4, (), ())
        assert nominal.probe_answers == {"pump/state": 16}
        assert (nominal.main_ends, nominal.ends) == (False, False)
        rules = {str(rule) for rule in nominal.mined.rules}
        assert fault == "silent" or rules >= {"count of pump/state", "finite of pump/state:flow"}
        record = workspace.carry_out(ACTIVATE, folder, budget=20)
        assert isinstance(record, ActivationRecord)
        assert record.found is not None, record.text
        assert record.found[DIAL] > 200
        assert (record.replays, record.replays_failed) == (1, 1)
        assert reproduce(workspace, folder, times=1, whole_system=True).answer == "still failing"
