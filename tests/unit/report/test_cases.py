from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.findings.known import title_of
from riot_bus.report.campaign_view import CampaignView, as_campaign
from riot_bus.report.cases import ReportedCase, as_text, cases_of, suites_of
from riot_bus.report.format import clean
from riot_bus_testkit.reports import campaign_at, view_at


@pytest.mark.parametrize("name", ["finished", "hostile"])
def test_the_campaign_comes_before_its_findings(name: str, tmp_path: Path) -> None:
    view = campaign_at(name, tmp_path)
    (unit,) = suites_of(view)
    first, second, *others = cases_of(view, unit)
    assert (first.name, second.name) == ("nominal log", "campaign")
    assert [case.name for case in others] == [clean(title_of(one.finding), limit=300) for one in view.findings]


def test_a_finding_alone_is_its_only_case(tmp_path: Path) -> None:
    view = as_campaign(view_at("until activate", tmp_path))
    (case,) = cases_of(view, "planner")
    assert (case.result, case.name) == ("failure", title_of(view.findings[0].finding))
    assert case.seconds is not None


def test_nothing_is_known_before_the_unit_is() -> None:
    view = CampaignView(Path("out"), None, (), problem="no route")
    assert suites_of(view) == [""]
    assert [(case.result, case.message) for case in cases_of(view, "")] == [
        ("skipped", "not known before the campaign has ended"),
        ("error", "not finished (no route): 0 findings so far"),
    ]


def test_texts_are_safe_and_bounded() -> None:
    case = ReportedCase("x", "failure", message="a\x1b[2Jb" * 1000)
    assert case.text == case.line
    assert len(case.line) < 1000
    assert "\x1b" not in case.line
    assert as_text(["one\ttwo ", "three"] * 1000).count("\n") == 199
