from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from riot_bus.findings.known import fingerprint_of
from riot_bus.findings.records import FindingRecord
from riot_bus.report.campaign_view import CampaignView, load_campaign
from riot_bus.report.sarif import SarifReport
from riot_bus_testkit.reports import CAMPAIGNS, campaign_at
from tests.unit.report.test_campaign_view import several
from tests.unit.report.test_location import Bench


def run_of(view: CampaignView) -> dict[str, Any]:
    log = json.loads(SarifReport().render_campaign(view))
    assert (log["version"], len(log["runs"])) == ("2.1.0", 1)
    run: dict[str, Any] = log["runs"][0]
    return run


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_each_result_has_what_viewers_need(name: str, tmp_path: Path) -> None:
    view = campaign_at(name, tmp_path)
    run = run_of(view)
    rules = run["tool"]["driver"]["rules"]
    assert len({rule["id"] for rule in rules}) == len(rules)
    assert all(rule[part]["text"] for rule in rules for part in ("shortDescription", "fullDescription", "help"))
    assert len(run["results"]) == len(view.current)
    for result in run["results"]:
        assert rules[result["ruleIndex"]]["id"] == result["ruleId"]
        assert result["message"]["text"]
        (location,) = result["locations"]
        assert location["physicalLocation"]["region"]["startLine"] >= 1
        artifact = location["physicalLocation"]["artifactLocation"]
        assert artifact["uri"]
        assert not artifact["uri"].startswith("/")
        assert artifact["uriBaseId"] in run["originalUriBaseIds"]


def test_a_result_has_rule_level_rate_and_the_way_back(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    folder = tmp_path / "findings" / "planner-crash-1f3a"
    record = FindingRecord.load(folder).model_copy(update={"severity": "abort"})
    record = FindingRecord.model_validate(
        record.model_dump() | {"rate": {"value": 1.0, "low": 0.4, "high": 1.0, "count": 4, "total": 4}}
    )
    record.save(folder)
    run = run_of(load_campaign(tmp_path))
    (result,) = run["results"]
    assert (result["ruleId"], result["level"]) == ("crash", "error")
    assert result["message"]["text"].startswith("planner crashes when /map:x < 0; ")
    properties = result["properties"]
    assert properties["rate"] == {"value": 1.0, "low": 0.4, "high": 1.0, "count": 4, "total": 4}
    assert properties["rule"] == "/map:x < 0"
    assert properties["reproduce"] == f"riot reproduce {folder}"
    assert run["automationDetails"] == {"id": "riot_bus/planner/"}


@pytest.mark.parametrize(
    ("name", "successful", "level"),
    [
        ("finished", True, "note"),
        ("nothing found", True, "note"),
        ("inconclusive", True, "warning"),
        ("not finished", False, "warning"),
    ],
)
def test_how_the_campaign_ended_is_told(name: str, successful: bool, level: str, tmp_path: Path) -> None:
    (invocation,) = run_of(campaign_at(name, tmp_path))["invocations"]
    assert invocation["executionSuccessful"] is successful
    assert invocation["toolExecutionNotifications"][0]["level"] == level


def test_the_fingerprint_stays_when_lines_shift_and_the_place_follows(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    results = []
    for line in (35, 57):
        bench.view(stderr=bench.traceback(line=line))
        (result,) = run_of(load_campaign(tmp_path / "out"))["results"]
        results.append(result)
    first, second = results
    assert [each["locations"][0]["physicalLocation"]["region"]["startLine"] for each in results] == [35, 57]
    assert first["partialFingerprints"] == second["partialFingerprints"]
    uris = {each["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] for each in results}
    assert uris == {"robots/rover/rover/workspace.py"}


def test_the_fingerprint_is_of_component_and_signature_alone(tmp_path: Path) -> None:
    finding = campaign_at("finished", tmp_path).findings[0].finding
    known = fingerprint_of(finding)
    for same in ({"occurrences": 7}, {"details": ("x.py:77",)}, {"system_file": "/elsewhere/riot.toml"}, {"seed": 3}):
        assert fingerprint_of(finding.model_copy(update=same)) == known
    for other in ({"component": "mapper"}, {"signature": "x"}, {"whole_system": True}, {"id": "a-missing"}):
        assert fingerprint_of(finding.model_copy(update=other)) != known
    assert fingerprint_of(finding.model_copy(update={"signature": "\ud800"}))


def test_several_findings_at_one_place_stay_apart(tmp_path: Path) -> None:
    campaign_at("several", tmp_path)
    for number, folder in enumerate(sorted((tmp_path / "findings").iterdir())):
        FindingRecord.load(folder).model_copy(update={"signature": f"silent: {number}"}).save(folder)
    results = run_of(load_campaign(tmp_path))["results"]
    assert len({json.dumps(each["locations"]) for each in results}) == 1
    assert len({each["partialFingerprints"]["primaryLocationLineHash"] for each in results}) == 3


def test_paths_are_uris_and_messages_have_no_links_and_no_placeholders(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    (bench.code / "a b#.toml").write_text("[unit.planner]\n")
    view = bench.view(system=bench.code / "a b#.toml", signature="crash in planner: [here](http://x) {0}")
    record = view.finding.model_copy(update={"component": "[here](http://x) {0}"})
    record.save(bench.finding)
    (result,) = run_of(load_campaign(tmp_path / "out"))["results"]
    assert result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == "robots/rover/a%20b%23.toml"
    assert "](" not in result["message"]["text"]
    assert "{{0}}" in result["message"]["text"]


def test_findings_of_other_code_are_left_out(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    folder = tmp_path / "findings" / "planner-crash-1f3a"
    FindingRecord.load(folder).model_copy(update={"fingerprint": "other"}).save(folder)
    assert run_of(load_campaign(tmp_path))["results"] == []


def test_known_findings_are_suppressed_with_what_people_say(tmp_path: Path) -> None:
    view = several(tmp_path)
    results = run_of(view)["results"]
    assert [one["baselineState"] for one in results] == ["unchanged", "new", "new"]
    assert [one.get("suppressions") for one in results] == [
        [{"kind": "external", "status": "accepted", "justification": "known: since 2026-03-01"}], None, None
    ]  # fmt: skip
    assert not any("baselineState" in one for one in run_of(replace(view, known=None))["results"])


def test_what_was_learnt_besides_is_a_notification(tmp_path: Path) -> None:
    view = load_campaign(tmp_path, finished=False, problem="no port", unit="planner", fingerprint="1f3a")
    (invocation,) = run_of(replace(view, excused=True, remarks=("fixed: x",)))["invocations"]
    told = [(one["level"], one["message"]["text"]) for one in invocation["toolExecutionNotifications"]]
    assert told[:2] == [("warning", "no port"), ("note", "fixed: x")]
    assert not invocation["executionSuccessful"]
