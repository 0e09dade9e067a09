"""Trials of a unit whose process goes on, with real processes."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps.robustness import test_unit as run_campaign
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.log.reader import LogReader
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import TestCase, Verdict
from tests.systems.misbehaviour.catalogue import HISTORY, write

pytestmark = [pytest.mark.integration, pytest.mark.timeout(240)]

BAD = Injection("cmd", "x", 1e9, first=3, last=3)


def test_a_process_goes_on_until_it_fails_and_failures_are_those_of_a_fresh_one(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace("[unit.raises]\n", "[unit.raises]\nmined = false\n"))
    with Workspace(path, tmp_path / "out", jobs=1) as workspace:
        log = workspace.unit_log("raises")
        runner = workspace.runners.unit("raises", lambda: log, persistent=True)
        passing = [TestCase(log, seed=number) for number in range(3)]
        outcomes = runner.run([*passing, TestCase(log, (BAD,)), TestCase(log, seed=3)])
        assert [one.verdict for one in outcomes] == ["pass", "pass", "pass", "fail", "pass"]
        started = [str(one.statistics["started"]) for one in outcomes]
        assert started[1].startswith("persistent")
        assert started[3] == "forked"
        assert started[4] == "persistent, forked"
        assert outcomes[3].violations[0].signature == 'crash in raises: misbehave: raise ValueError("bad")'
        assert "history" not in outcomes[3].statistics  # a fresh process fails so, too
        states = [one.statistics["shown"]["state"] for one in outcomes[:3]]
        assert len({count for count, _ in states}) == 1
        assert len({digest for _, digest in states}) == 3
    left = [each.name for each in (tmp_path / "out" / "trials").iterdir()]
    assert not [name for name in left if name.startswith(("trial-", "persistent-"))]


@pytest.mark.rotating
def test_what_fails_after_other_cases_alone_is_shrunk_to_one_log(tmp_path: Path) -> None:
    with Workspace(write(tmp_path), tmp_path / "out", jobs=1) as workspace:
        (folder,) = run_campaign(workspace, HISTORY, trials=8, seconds=None, covered=False)
        finding = FindingRecord.load(folder)
        assert finding.signature == f'crash in {HISTORY}: handle: raise ValueError("bad after sixty others")'
        assert finding.rate is not None
        assert finding.rate.value == 1.0
        assert "earlier test cases)" in finding.details[0]
        with LogReader(folder / "failure.mcap") as reader:
            commands = [each for each in reader.messages() if each.key == "cmd"]
        assert len(commands) > 60
        record = CampaignRecord.load(workspace.out)
        assert record.started.endswith("forked")
        assert not record.unconfirmed
        log = workspace.unit_log(HISTORY)
        assert workspace.runners.unit(HISTORY, lambda: log).run([TestCase(log, (BAD,))])[0].verdict is Verdict.PASS


@pytest.mark.rotating
def test_a_reset_makes_the_process_as_it_was(tmp_path: Path) -> None:
    path, head = write(tmp_path), f"[unit.{HISTORY}]\n"
    reset = """reset = { topic = "cmd", payload = '{"reset": 1}' }\n"""
    path.write_text(path.read_text().replace(head, head + reset))
    with Workspace(path, tmp_path / "out", jobs=1) as workspace:
        log = workspace.unit_log(HISTORY)
        runner = workspace.runners.unit(HISTORY, lambda: log, persistent=True)
        outcomes = runner.run([TestCase(log, (BAD,), seed=number) for number in range(4)])
        assert {str(one.statistics["started"]) for one in outcomes[1:]} == {"persistent, forked"}
        assert {one.verdict for one in outcomes} == {Verdict.PASS}
        assert not any("history" in one.statistics for one in outcomes)


@pytest.mark.rotating
def test_a_reset_that_does_not_reach_the_unit_is_an_error(tmp_path: Path) -> None:
    path, head = write(tmp_path), f"[unit.{HISTORY}]\n"
    path.write_text(path.read_text().replace(head, f"""{head}reset = {{ topic = "comand", payload = '1' }}\n"""))
    with Workspace(path, tmp_path / "out", jobs=1) as workspace:
        log = workspace.unit_log(HISTORY)
        with pytest.raises(ConfigError, match="no component has subscribed to 'comand'"):
            workspace.runners.unit(HISTORY, lambda: log, persistent=True).run([TestCase(log)])
