"""Units that misbehave are found and named rightly, robust ones are not found: real processes on a real bus."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.chain.robustness import test_unit as run_campaign
from riot_bus.chain.workspace import Workspace
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.sut.evidence import has_debugger
from tests.systems.misbehaviour.catalogue import FAULTY, ROBUST, write
from tests.tiers import scaled

pytestmark = [pytest.mark.integration, pytest.mark.timeout(900)]

TRIALS = 16
CAMPAIGNS = 2


@pytest.mark.parametrize("seed", range(scaled(CAMPAIGNS)))
@pytest.mark.parametrize("kind", FAULTY)
def test_a_fault_is_found_and_named(tmp_path: Path, kind: str, seed: int) -> None:
    with Workspace(write(tmp_path), tmp_path / "out", jobs=2, seed=seed) as workspace:
        trials = TRIALS * (4 if kind in ("sometimes", "segfaults") else 1)
        folders = run_campaign(workspace, kind, trials=trials, seconds=None)
        records = [FindingRecord.load(folder) for folder in folders]
    wanted = FAULTY[kind]
    wanted = (wanted,) if isinstance(wanted, str) else wanted
    assert sorted(record.signature for record in records) == [each.format(kind) for each in wanted]
    for folder, record in zip(folders, records, strict=True):
        assert record.rate is not None
        assert record.rate.count == record.rate.total or kind == "sometimes"
        assert record.nominal is not None
        assert record.nominal.count == 0
        evidence = {path.name: path for path in (folder / "evidence").iterdir()}
        assert {"trial.json", "outputs.mcap", f"{kind}.resources.csv"} <= evidence.keys()
        if record.monitor == "crash" and kind != "exit_status":
            told = evidence[f"{kind}.{'stdout' if kind == 'stdout_traceback' else 'stderr'}.txt"].read_text()
            assert "misbehave" in told
        if record.monitor == "hang":
            assert record.signature.rpartition(" ")[2] in evidence[f"{kind}.stacks.txt"].read_text()
        if kind == "segfaults" and has_debugger():
            assert "memset" in evidence["backtrace.txt"].read_text()
    assert not CampaignRecord.load(tmp_path / "out").notes


@pytest.mark.parametrize("seed", range(scaled(CAMPAIGNS)))
@pytest.mark.parametrize("kind", ROBUST)
def test_a_robust_unit_has_no_finding(tmp_path: Path, kind: str, seed: int) -> None:
    with Workspace(write(tmp_path), tmp_path / "out", jobs=2, seed=seed) as workspace:
        assert run_campaign(workspace, kind, trials=TRIALS, seconds=None) == []
    record = CampaignRecord.load(tmp_path / "out")
    assert (record.unconfirmed, record.notes) == ((), {})
