"""A campaign on the running system finds what comes of a wrong outside: real processes on a real bus."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps.reproduce import reproduce
from riot_bus.chain.steps.robustness import test_unit as run_campaign
from riot_bus.chain.steps.robustness import tested as finished
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.findings.steps import MINIMIZE
from riot_bus.log.reader import read_log
from riot_bus.vocabulary.errors import ConfigError, InconclusiveError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import TestCase, Verdict
from tests.integration.test_activation_by_signs import DIAL, SIGNATURES, write

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]


def test_what_comes_from_outside_makes_the_unit_end(tmp_path: Path) -> None:
    with Workspace(write(tmp_path, "exit"), tmp_path / "out", jobs=2) as workspace:
        (folder,) = run_campaign(workspace, "pump", trials=16, seconds=None, covered=False, whole_system=True)
        record, campaign = FindingRecord.load(folder), CampaignRecord.load(tmp_path / "out")
        assert (record.signature, record.whole_system) == (SIGNATURES["exit"], True)
        assert record.rate is not None
        assert record.rate.count == record.rate.total
        topic, field = DIAL.split(":")
        assert {(each["topic"], each["field"]) for each in record.injections} == {(topic, field)}
        assert sum(record.delivered) >= 1
        assert {message.key for message in read_log(folder / "failure.mcap")} == {topic}
        assert (folder / "evidence" / "trial.json").is_file()
        assert campaign.whole_system
        assert campaign.covered > 0
        assert finished(workspace, "pump") is None, "this was no campaign on the unit"
        with pytest.raises(InconclusiveError, match="found in runs of the whole system"):
            workspace.carry_out(MINIMIZE, folder)
        assert reproduce(workspace, folder).answer == "still failing"


def test_what_cannot_be_intercepted_is_told_before_the_first_run(tmp_path: Path) -> None:
    path = write(tmp_path, "exit")
    path.write_text(path.read_text().replace('segment = "outside"', 'segment = "inside"'))
    with (
        Workspace(path, tmp_path / "out", jobs=1) as workspace,
        pytest.raises(ConfigError, match="external components share segment"),
    ):
        run_campaign(workspace, "pump", trials=1, seconds=None, covered=False, whole_system=True)


def test_what_injections_changed_is_counted_in_the_run(tmp_path: Path) -> None:
    topic, field = DIAL.split(":")
    injections = (Injection(topic, field, 50.0, first=0, last=1), Injection(topic, "nowhere", 1.0))
    with Workspace(write(tmp_path, "exit"), tmp_path / "out", jobs=1) as workspace:
        runner = workspace.runners.system(workspace.context.file.system.trial_run)
        (outcome,) = runner.run([TestCase(injections=injections)])
    assert outcome.verdict is Verdict.PASS
    assert (outcome.statistics["delivered"], outcome.statistics["modified"]) == ([1, 0], 1), (
        "the first one was 50 already"
    )
