from __future__ import annotations

import html
import json
import uuid
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from riot_bus.findings.known import KnownFinding, fingerprint_of
from riot_bus.findings.records import FindingRecord, ProportionRecord
from riot_bus.report.allure import _SEVERITY, AllureReport
from riot_bus.report.campaign_view import CampaignView, load_campaign
from riot_bus.report.formats import write_file
from riot_bus.testing.reports import CAMPAIGNS, campaign_at
from riot_bus.vocabulary.trial import SEVERITIES
from tests.unit.report.test_junit import cases

FIELDS = {
    "uuid": str,
    "historyId": str,
    "testCaseId": str,
    "fullName": str,
    "name": str,
    "status": str,
    "stage": str,
    "statusDetails": dict,
    "description": str,
    "labels": list,
    "attachments": list,
    "start": int,
    "stop": int,
}
"""What we use of a result of Allure 2, and the types that it has there."""
DETAILS = {"message": str, "trace": str, "known": bool, "flaky": bool}
ONE = "planner-crash-1f3a"
SIGNATURE = "IndexError in costmap.py:update"


def written(view: CampaignView, folder: Path) -> dict[str, dict[str, Any]]:
    """Return the results by the names of their cases, after a look at their files."""
    found = {}
    folder.mkdir(exist_ok=True)
    for path in write_file(AllureReport().render_campaign(view), folder).glob("*-result.json"):
        result = json.loads(path.read_text())
        assert path.name == f"{uuid.UUID(result['uuid'])}-result.json"
        for key, value in result.items():
            assert type(value) is FIELDS[key]
        for key, value in result.get("statusDetails", {}).items():
            assert type(value) is DETAILS[key]
        assert all(set(label) == {"name", "value"} and all(label.values()) for label in result["labels"])
        for each in result["attachments"]:
            assert set(each) == {"name", "source", "type"}
            assert (folder / each["source"]).is_file()
        found[result["name"]] = result
    return found


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_it_has_the_cases_that_junit_has(name: str, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    view = campaign_at(name, tmp_path / "out")
    status = {"passed": "passed", "failure": "failed", "error": "broken", "skipped": "skipped"}
    found = written(view, tmp_path / "results")
    assert {case: each["status"] for case, each in found.items()} == {
        case: status[result] for case, result in cases(view).items()
    }
    assert len({each["historyId"] for each in found.values()}) == len(found)


def test_a_finding_has_its_log_and_its_page(tmp_path: Path) -> None:
    out, results = tmp_path / "out", tmp_path / "results"
    out.mkdir()
    view = campaign_at("finished", out)
    folder = out / "findings" / ONE
    assert (folder / "minimal.json").is_file()
    assert written(view, results)[SIGNATURE]["attachments"] == []
    for name in ("failure.mcap", "minimal.mcap", "report.html"):
        (folder / name).write_text(name)
    found = written(view, results)[SIGNATURE]
    log, page = found["attachments"]
    assert (log["name"], (results / log["source"]).read_text()) == ("minimal log", "minimal.mcap")
    shown = (results / page["source"]).read_text()
    assert page["name"] == "report"
    assert SIGNATURE in html.unescape(shown)  # made anew: what lies there may be a page of somebody else
    assert "report.html" not in shown.partition("<body")[0]
    (folder / "minimal.json").unlink()  # not finished
    log, _ = written(load_campaign(out), results)[SIGNATURE]["attachments"]
    assert (log["name"], (results / log["source"]).read_text()) == ("failing log", "failure.mcap")
    assert len(list(results.glob("*-attachment*"))) == 2
    assert "riot reproduce" in found["statusDetails"]["trace"]
    assert ONE in found["description"]


def test_places_on_the_crash_scale_are_severities(tmp_path: Path) -> None:
    assert list(_SEVERITY) == list(SEVERITIES)
    campaign_at("finished", tmp_path)
    folder = tmp_path / "findings" / ONE
    FindingRecord.load(folder).model_copy(update={"severity": "abort"}).save(folder)
    labels = written(load_campaign(tmp_path), tmp_path / "results")[SIGNATURE]["labels"]
    told = {each["name"]: each["value"] for each in labels}
    assert (told["suite"], told["subSuite"], told["severity"]) == ("planner", "planner", "critical")


def test_a_case_is_the_same_one_in_a_later_run(tmp_path: Path) -> None:
    views = []
    for number in range(2):
        (tmp_path / str(number)).mkdir()
        views.append(campaign_at("finished", tmp_path / str(number)))
    first, second = (written(view, tmp_path / "results") for view in views)
    assert {name: (each["uuid"], each["historyId"], each["testCaseId"]) for name, each in first.items()} == {
        name: (each["uuid"], each["historyId"], each["testCaseId"]) for name, each in second.items()
    }
    assert len(list((tmp_path / "results").glob("*-result.json"))) == len(first)


def test_what_a_baseline_knows_is_known_and_what_fails_at_times_is_flaky(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    campaign_at("finished", out)
    folder = out / "findings" / ONE
    record = FindingRecord.load(folder)
    rate = ProportionRecord(count=3, total=8, value=3 / 8, low=0.1, high=0.7)
    record.model_copy(update={"rate": rate}).save(folder)
    entry = KnownFinding.of(record, since="2026-03-01", note="ticket 12")
    view = replace(load_campaign(out), known={fingerprint_of(record): entry})
    details = written(view, tmp_path / "results")[SIGNATURE]["statusDetails"]
    assert (details["known"], details["flaky"]) == (True, True)
    assert "ticket 12" in details["message"]


def test_files_of_others_in_the_folder_stay(tmp_path: Path) -> None:
    out, results = tmp_path / "out", tmp_path / "results"
    out.mkdir()
    results.mkdir()
    (results / "1-result.json").write_text("{}")
    write_file(AllureReport().render_campaign(campaign_at("nothing found", out)), results)
    assert (results / "1-result.json").read_text() == "{}"
    assert not list(results.glob("*.part"))
