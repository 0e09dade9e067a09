from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from riot_bus.findings.known import title_of
from riot_bus.findings.records import CampaignRecord, FindingRecord, ProportionRecord
from riot_bus.report.campaign_view import CampaignView, as_campaign, load_campaign
from riot_bus.report.junit import JunitReport
from riot_bus_testkit.reports import CAMPAIGNS, campaign_at, view_at
from tests.unit.report.test_campaign_view import several

XUNIT2 = {
    "testsuites": ({"name", "time", "tests", "failures", "errors"}, {"testsuite"}),
    "testsuite": (
        {"name", "tests", "failures", "errors", "skipped", "time", "file"},
        {"properties", "testcase"},
    ),
    "properties": (set(), {"property"}),
    "property": ({"name", "value"}, set()),
    "testcase": ({"name", "classname", "time"}, {"skipped", "error", "failure", "system-out"}),
    "failure": ({"type", "message"}, set()),
    "error": ({"type", "message"}, set()),
    "skipped": ({"type", "message"}, set()),
    "system-out": (set(), set()),
}
"""What we use of xunit2 (Jenkins' junit-10.xsd): the attributes and children that it allows."""
SIGNATURE = "IndexError in costmap.py:update"


def document(view: CampaignView) -> ElementTree.Element:
    return ElementTree.fromstring(JunitReport().render_campaign(view))


def cases(view: CampaignView) -> dict[str, str]:
    """Return how each case has ended."""
    found = {}
    for case in document(view).iter("testcase"):
        ends = [child.tag for child in case if child.tag != "system-out"]
        assert len(ends) <= 1
        found[case.attrib["name"]] = ends[0] if ends else "passed"
    return found


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_it_is_xunit2(name: str, tmp_path: Path) -> None:
    root = document(campaign_at(name, tmp_path))
    assert root.tag == "testsuites"
    for element in root.iter():
        attributes, children = XUNIT2[element.tag]
        assert set(element.attrib) <= attributes
        assert {child.tag for child in element} <= children
    for suite in root:
        assert {"name", "tests", "failures", "errors"} <= set(suite.attrib)
        assert re.fullmatch(r"[0-9]*\.[0-9]*", suite.attrib["time"])
        ends = [child.tag for case in suite.iter("testcase") for child in case]
        assert len(list(suite.iter("testcase"))) == int(suite.attrib["tests"])
        assert [suite.attrib[key] for key in ("failures", "errors", "skipped")] == [
            str(ends.count(tag)) for tag in ("failure", "error", "skipped")
        ]


@pytest.mark.parametrize(
    ("name", "nominal", "campaign"),
    [
        ("nothing found", "skipped", "passed"),
        ("finished", "skipped", "passed"),
        ("inconclusive", "skipped", "skipped"),
        ("not judged", "skipped", "error"),
        ("a broken finding", "skipped", "error"),
        ("not finished", "skipped", "error"),
    ],
)
def test_each_end_is_told_as_what_it_is(name: str, nominal: str, campaign: str, tmp_path: Path) -> None:
    found = cases(campaign_at(name, tmp_path))
    assert (found.pop("nominal log"), found.pop("campaign")) == (nominal, campaign)
    assert found == ({SIGNATURE: "failure"} if CAMPAIGNS[name][1] else {})


def test_a_nominal_log_has_passed_if_none_of_its_trials_failed(tmp_path: Path) -> None:
    campaign_at("nothing found", tmp_path)
    record = CampaignRecord.load(tmp_path)
    (seen,), (alarm,) = record.unconfirmed, record.untold
    for changes, end, told in (
        ({"unconfirmed": (), "untold": ("where its threads stand: it is no Python program",)}, "passed", ""),
        ({"unconfirmed": ()}, "skipped", f"not told: {alarm}"),
        ({"untold": ()}, "skipped", f"failed in a trial of the nominal log, not confirmed: {seen.signature}"),
        ({"untold": (), "unconfirmed": (seen.model_copy(update={"injections": ({"topic": "/map"},)}),)}, "passed", ""),
    ):
        record.model_copy(update=changes).save(tmp_path)
        view = load_campaign(tmp_path)
        assert cases(view)["nominal log"] == end
        assert [each.attrib["message"] for each in document(view).iter("skipped")] == ([told] if told else [])


def test_a_suite_without_failures_names_its_file_too(tmp_path: Path) -> None:
    campaign_at("nothing found", tmp_path)
    assert "file" not in document(load_campaign(tmp_path))[0].attrib  # of an older record
    CampaignRecord.load(tmp_path).model_copy(update={"system_file": "rover/riot.toml"}).save(tmp_path)
    assert document(load_campaign(tmp_path))[0].attrib["file"] == "rover/riot.toml"


def test_what_stopped_the_work_is_an_error(tmp_path: Path) -> None:
    campaign_at("nothing found", tmp_path)
    view = load_campaign(tmp_path, problem="port 7447 is in use")
    assert cases(view)["campaign"] == "error"
    assert "port 7447 is in use" in JunitReport().render_campaign(view)


def test_a_nominal_log_that_fails_is_a_failure(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    folder = tmp_path / "findings" / "planner-crash-1f3a"
    rate = ProportionRecord(value=0.5, low=0.1, high=0.9, count=2, total=4)
    FindingRecord.load(folder).model_copy(update={"nominal": rate}).save(folder)
    assert cases(load_campaign(tmp_path))["nominal log"] == "failure"
    told = JunitReport().render_campaign(load_campaign(tmp_path))
    assert f"2 of 4 trials of the nominal log failed: {SIGNATURE}" in told


def test_a_failure_says_what_when_and_how_to_see_it_again(tmp_path: Path) -> None:
    view = campaign_at("finished", tmp_path)
    (failure,) = document(view).iter("failure")
    assert failure.attrib["message"].startswith("planner crashes when /map:x < 0; ")
    assert failure.attrib["type"] == "crash"
    text = failure.text or ""
    assert text.startswith(
        "at rover/riot.toml:1\nunit planner of rover/riot.toml:1\nTraceback (most recent call last):\n"
    )
    assert "planner crashes when /map:x < 0" in text
    assert "5\N{NO-BREAK SPACE}012 messages (38 modified) -> 1 needed" in text
    assert f"riot reproduce {tmp_path}/findings/planner-crash-1f3a" in text


def test_properties_have_the_figures_and_times_come_from_the_records(tmp_path: Path) -> None:
    suite = document(campaign_at("finished", tmp_path))[0]
    properties = {each.attrib["name"]: each.attrib["value"] for each in suite.iter("property")}
    assert properties["riot.trials"] == "120"
    assert properties["planner-crash-1f3a.rule"] == "/map:x < 0"
    assert properties["planner-crash-1f3a.reproduce"].startswith("riot reproduce ")
    assert suite.attrib | {"time": "341.000", "file": "rover/riot.toml", "name": "planner"} == suite.attrib
    assert [case.attrib.get("time") for case in suite.iter("testcase")] == [None, "341.000", "0.000"]


def test_names_stay_the_same_from_run_to_run(tmp_path: Path) -> None:
    before = cases(campaign_at("several", tmp_path))
    for folder in (tmp_path / "findings").iterdir():
        record = FindingRecord.load(folder)
        record.model_copy(update={"occurrences": 99, "details": ("line 77",), "seconds": 1.0}).save(folder)
    CampaignRecord.load(tmp_path).model_copy(update={"tested": 7, "seed": 3}).save(tmp_path)
    assert list(cases(load_campaign(tmp_path))) == list(before)


def test_units_have_a_suite_each(tmp_path: Path) -> None:
    campaign_at("several", tmp_path)
    folder = tmp_path / "findings" / "2"
    FindingRecord.load(folder).model_copy(update={"unit": "mapper"}).save(folder)
    suites = {suite.attrib["name"]: len(suite.findall("testcase")) for suite in document(load_campaign(tmp_path))}
    assert suites == {"planner": 4, "mapper": 1}


def test_findings_of_other_code_are_no_failures(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    folder = tmp_path / "findings" / "planner-crash-1f3a"
    FindingRecord.load(folder).model_copy(update={"fingerprint": "other"}).save(folder)
    assert cases(load_campaign(tmp_path))[SIGNATURE] == "skipped"


def test_one_finding_alone_has_one_case(tmp_path: Path) -> None:
    assert cases(as_campaign(view_at("until rules", tmp_path))) == {SIGNATURE: "failure"}


def test_whatever_xml_cannot_hold_is_written_as_an_escape(tmp_path: Path) -> None:
    view = view_at("until test", tmp_path)
    signature = "a ]]> b <c> & \x00\x08\x0b\x1b\x7f\ud800\ufffe\uffff\n\r\"'"
    view.finding.model_copy(update={"signature": signature, "component": "<x>", "monitor": "\x0c"}).save(tmp_path)
    text = JunitReport().render_campaign(load_campaign_of(tmp_path))
    text.encode()
    (case,) = ElementTree.fromstring(text).iter("testcase")
    assert case.attrib["name"] == ("a ]]> b <c> & \\x00\\x08\\x0b\\x1b\\x7f\\ud800\\ufffe\\uffff\\n\\r\"'")


def load_campaign_of(finding: Path) -> CampaignView:
    from riot_bus.report.finding_view import load

    return as_campaign(load(finding))


def test_known_findings_are_skipped_and_those_that_come_back_are_not(tmp_path: Path) -> None:
    view = several(tmp_path)
    found = cases(view)
    assert [found[title_of(one.finding)] for one in view.current] == ["skipped", "failure", "failure"]
    _, skipped = document(view).iter("skipped")
    assert (skipped.attrib["type"], skipped.attrib["message"]) == ("known", "known: since 2026-03-01")
    assert f"riot reproduce {view.current[0].directory}" in (skipped.text or "")
    (back, _) = document(view).iter("failure")
    assert (back.text or "").startswith("came back: was fixed 2026-03-02\nat ")


def test_what_fresh_trials_have_shown_to_be_fixed_passes(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    folder = tmp_path / "findings" / "planner-crash-1f3a"
    old = FindingRecord.load(folder).model_copy(update={"fingerprint": "old"})
    for fixed_in, end in (("1f3a", "passed"), ("other", "skipped"), ("", "skipped")):
        old.model_copy(update={"fixed_in": fixed_in}).save(folder)
        assert cases(load_campaign(tmp_path))[SIGNATURE] == end


def test_a_campaign_that_was_ended_early_has_not_passed(tmp_path: Path) -> None:
    campaign_at("nothing found", tmp_path)
    CampaignRecord.load(tmp_path).model_copy(update={"stopped": "it was enough"}).save(tmp_path)
    assert cases(load_campaign(tmp_path))["campaign"] == "skipped"


def test_surroundings_that_are_excused_are_an_error_and_no_failure(tmp_path: Path) -> None:
    view = load_campaign(tmp_path, finished=False, problem="no port", unit="planner", fingerprint="1f3a")
    view = replace(view, excused=True, remarks=("fixed: x",))
    assert cases(view)["campaign"] == "error"
    (error,) = document(view).iter("error")
    assert (error.attrib["type"], error.attrib["message"]) == ("environment", "not tested: no port")
    assert "fixed: x" in (error.text or "")
