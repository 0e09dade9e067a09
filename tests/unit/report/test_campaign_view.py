from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.findings.known import KnownFinding
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.report.campaign_view import CampaignView, as_campaign, is_output_folder, level_of, load_campaign
from riot_bus_testkit.reports import campaign_at, view_at

ONE = "planner-crash-1f3a"


@pytest.mark.parametrize(
    ("name", "verdict"),
    [
        ("finished", "1 finding in 120 trials of planner"),
        ("nothing found", "no finding in 120 trials of planner"),
        ("not finished", "not finished: 1 finding of planner so far"),
        ("nothing done", "not finished: 0 findings so far"),
        ("inconclusive", "inconclusive: no finding in 120 trials of planner, but rate: nothing came on /plan"),
        (
            "not judged",
            "inconclusive: no finding in 120 trials of planner, but 3 test cases could not be judged: its process was "
            "killed",
        ),
        ("several", "1 finding in 120 trials of planner; 2 more findings of the same code, found otherwise"),
        ("broken", "not finished: 1 finding of planner so far"),
    ],
)
def test_a_verdict_says_what_is_known(name: str, verdict: str, tmp_path: Path) -> None:
    assert campaign_at(name, tmp_path).verdict == verdict


def test_runs_of_the_whole_system_are_called_so(tmp_path: Path) -> None:
    campaign_at("nothing found", tmp_path)
    CampaignRecord.load(tmp_path).model_copy(update={"whole_system": True}).save(tmp_path)
    assert load_campaign(tmp_path).verdict == "no finding in 120 runs of the whole system"


def test_why_work_has_ended_early_is_told(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    assert load_campaign(tmp_path, problem="no route").verdict == (
        "1 finding in 120 trials of planner; then it stopped: no route"
    )
    begun = load_campaign(tmp_path, finished=False, problem="no route", unit="planner", fingerprint="1f3a")
    assert begun.verdict == "not finished (no route): 1 finding of planner so far"
    assert (begun.campaign, begun.finished) == (None, False)


def test_the_worst_comes_first(tmp_path: Path) -> None:
    campaign_at("several", tmp_path)
    severities = {"1": "restart", "2": "silent", ONE: "abort"}
    for name, severity in severities.items():
        folder = tmp_path / "findings" / name
        FindingRecord.load(folder).model_copy(update={"severity": severity, "id": name}).save(folder)
    view = load_campaign(tmp_path)
    assert [one.finding.id for one in view.findings] == ["1", ONE, "2"]
    assert [level_of(one.finding) for one in view.findings] == ["error", "error", "warning"]


def test_what_cannot_be_used_is_told_and_not_fatal(tmp_path: Path) -> None:
    view = campaign_at("a broken finding", tmp_path)
    assert list(view.broken) == [f"findings/{ONE}/finding.json"]
    assert "this file cannot be used" in view.doubts[0]
    assert len(view.findings) == 1
    (tmp_path / "findings" / ONE / "finding.json").unlink()
    assert load_campaign(tmp_path).broken == {f"findings/{ONE}": "it is not there"}


def test_a_finding_of_other_code_is_no_finding_of_this_campaign(tmp_path: Path) -> None:
    campaign_at("several", tmp_path)
    folder = tmp_path / "findings" / "2"
    FindingRecord.load(folder).model_copy(update={"fingerprint": "other"}).save(folder)
    view = load_campaign(tmp_path)
    assert [one.directory.name for one in view.earlier] == ["2"]
    assert len(view.current) == 2
    begun = load_campaign(tmp_path, finished=False, fingerprint="other")
    assert [one.directory.name for one in begun.earlier] == [], "records without a fingerprint are of any code"
    assert [one.directory.name for one in load_campaign(tmp_path, finished=False, fingerprint="x").earlier] == ["2"]


def test_one_finding_alone_is_neither_finished_nor_not(tmp_path: Path) -> None:
    view = as_campaign(view_at("until rules", tmp_path))
    assert (view.finished, view.verdict, len(view.current), view.doubts) == (True, "1 finding of planner", 1, [])
    assert view.unit == "planner"


def test_an_output_folder_is_told_from_a_finding(tmp_path: Path) -> None:
    campaign_at("not finished", tmp_path)
    assert is_output_folder(tmp_path)
    assert not is_output_folder(tmp_path / "findings" / "0")
    assert not is_output_folder(tmp_path / "nowhere")
    (tmp_path / "only").mkdir()
    (tmp_path / "only" / "campaign.json").write_text(json.dumps({}))
    assert is_output_folder(tmp_path / "only")


def several(folder: Path) -> CampaignView:
    """A campaign with three findings: one is known, one was fixed, one is new."""
    campaign_at("several", folder)
    for path in (folder / "findings").iterdir():
        record = FindingRecord.load(path)
        record.model_copy(update={"signature": f"{record.signature} {path.name}"}).save(path)
    first, second, _ = (KnownFinding.of(one.finding, since="2026-03-01") for one in load_campaign(folder).findings)
    known = {first.fingerprint: first, second.fingerprint: second.model_copy(update={"fixed": "2026-03-02"})}
    return replace(load_campaign(folder), known=known)


def test_findings_that_the_baseline_knows_do_not_count(tmp_path: Path) -> None:
    view = several(tmp_path)
    assert [view.standing(one) for one in view.current] == ["known", "came back", "new"]
    assert view.failures == view.current[1:]
    assert [view.told(one) for one in view.current] == [
        "known: since 2026-03-01", "came back: was fixed 2026-03-02", "new"
    ]  # fmt: skip
    assert view.verdict == (
        "1 new finding in 120 trials of planner; 2 more findings (1 new) of the same code, found otherwise"
    )
    every = replace(view, known={})
    assert every.failures == every.current
    assert every.verdict.startswith("1 new finding in 120 trials")


def test_without_a_baseline_every_finding_counts_and_nothing_is_said_of_it(tmp_path: Path) -> None:
    view = campaign_at("several", tmp_path)
    assert view.failures == view.current
    assert {view.standing(one) for one in view.current} == {""}
    assert "new" not in view.verdict


def test_a_campaign_that_was_ended_early_says_why(tmp_path: Path) -> None:
    campaign_at("nothing found", tmp_path)
    CampaignRecord.load(tmp_path).model_copy(update={"stopped": "it was enough"}).save(tmp_path)
    assert load_campaign(tmp_path).verdict == "no finding in 120 trials of planner; ended early: it was enough"


def test_surroundings_that_are_excused_are_not_tested(tmp_path: Path) -> None:
    begun = load_campaign(tmp_path, finished=False, problem="no port", unit="planner", fingerprint="1f3a")
    assert replace(begun, excused=True).verdict == "not tested: no port"
    campaign_at("not finished", tmp_path)
    begun = load_campaign(tmp_path, problem="no port")
    assert replace(begun, excused=True).verdict == "not tested: no port; 1 finding of planner so far"
