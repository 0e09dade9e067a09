from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.report.campaign_view import CampaignView
from riot_bus.report.finding_view import FindingView
from riot_bus.report.formats import CampaignFormat, ReportFormat, append_summary, render, view_of, write_file
from riot_bus.report.github import GithubReport
from riot_bus.report.json_form import JsonReport
from riot_bus.report.junit import JunitReport
from riot_bus.report.markdown import MarkdownReport
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_testkit.reports import campaign_at, view_at


def test_a_format_reports_findings_campaigns_or_both() -> None:
    kinds = {one: (isinstance(one(), ReportFormat), isinstance(one(), CampaignFormat)) for one in (
        JsonReport, JunitReport, MarkdownReport
    )}  # fmt: skip
    assert kinds == {JsonReport: (True, False), JunitReport: (False, True), MarkdownReport: (True, True)}


def test_a_folder_is_read_as_what_it_is(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    assert isinstance(view_of(tmp_path), CampaignView)
    assert isinstance(view_of(tmp_path / "findings" / "planner-crash-1f3a"), FindingView)


def test_a_format_gets_what_it_knows(tmp_path: Path) -> None:
    view = view_at("until test", tmp_path)
    assert render(MarkdownReport(), view) == MarkdownReport().render(view)
    told = render(JunitReport(), view)
    assert isinstance(told, str)
    assert told.count("<testcase ") == 1
    campaign = CampaignView(tmp_path, None, ())
    assert render(JunitReport(), campaign) == JunitReport().render_campaign(campaign)
    with pytest.raises(ConfigError, match="one finding, not a campaign"):
        render(JsonReport(), campaign)


def test_a_summary_is_added_to_where_a_variable_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view, file = view_at("until test", tmp_path), tmp_path / "summary.md"
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    append_summary(GithubReport(), view)
    assert not file.exists()
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(file))
    append_summary(MarkdownReport(), view)
    assert not file.exists()
    append_summary(GithubReport(), view)
    assert file.read_text().startswith("## riot: 1 finding of planner\n")


def test_a_report_is_written_in_one_move(tmp_path: Path) -> None:
    path = tmp_path / "x"
    assert write_file("a", path) == write_file(b"b", path) == path
    assert path.read_text() == "b"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(ConfigError, match="cannot write the report"):
        write_file("a", tmp_path / "no" / "x")
