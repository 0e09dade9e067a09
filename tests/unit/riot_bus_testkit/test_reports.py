"""The shipped report formats hold what formats promise; broken ones are found out."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.plugins import REPORTS
from riot_bus.report.github import GithubReport
from riot_bus.report.json_form import JsonReport
from riot_bus.report.junit import JunitReport
from riot_bus.report.markdown import MarkdownReport
from riot_bus.report.page import HtmlReport
from riot_bus.report.sarif import SarifReport
from riot_bus.report.text import TextReport
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_testkit.reports import (
    CAMPAIGNS,
    FINDING_FILES,
    STAGES,
    CampaignReportConformance,
    ReportConformance,
    campaign_at,
    view_at,
)
from tests.report_samples import MarkdownConformance, OwnReportConformance

pytest.importorskip("jinja2")


class TestHtml(ReportConformance):
    report = HtmlReport
    markup = True


class TestJunit(OwnReportConformance):
    report = JunitReport
    markup = True


class TestSarif(OwnReportConformance):
    report = SarifReport


class TestGithub(OwnReportConformance):
    report = GithubReport


class TestMarkdown(MarkdownConformance):
    report = MarkdownReport


class TestText(ReportConformance):
    report = TextReport


class TestJson(ReportConformance):
    report = JsonReport


class Picture:
    file = "picture.bin"

    def render(self, view):
        return b"\xff" + view.severity.encode()


class TestPicture(ReportConformance):
    report = Picture
    binary = True


class Raw:
    file = "raw.html"

    def render(self, view):
        return f"<html><p>{view.finding.signature}</p></html>"


class Overwriting(Raw):
    file = "rule.json"


class OfRules(Raw):
    def render(self, view):
        return view.rule.text


class Writing(Raw):
    def render(self, view):
        (view.directory / "raw.html").write_text("x")
        return "x"


class RawCampaign:
    file = ""

    def render_campaign(self, view):
        return f"<html>{view.verdict}</html>"


class RawMarkdown:
    file = ""

    def render(self, view):
        return f"- `{view.finding.signature}`\n"

    def render_campaign(self, view):
        return f"|a|\n|---|\n|`{view.verdict}`|\n" if view.campaign else "not finished"


class Hopeful(RawCampaign):
    def render_campaign(self, view):
        return f"{len(view.findings)} findings\n"


def broken(report):
    made = CampaignReportConformance if hasattr(report, "render_campaign") else ReportConformance
    return type("Broken", (made,), {"report": report, "markup": True})()


def test_a_format_that_lets_names_become_tags_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        broken(Raw).test_hostile_names_stay_text(tmp_path)


def test_a_format_of_campaigns_that_lets_names_become_tags_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        broken(RawCampaign).test_hostile_names_of_campaigns_stay_text(tmp_path)


def test_markdown_that_names_can_leave_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        type("Broken", (MarkdownConformance,), {"report": RawMarkdown})().test_hostile_names_stay_text(tmp_path)


def test_a_format_that_takes_an_unfinished_campaign_for_a_clean_one_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        broken(Hopeful).test_campaigns_that_differ_are_told_apart(tmp_path)


def test_a_format_that_replaces_a_file_of_the_finding_is_found() -> None:
    with pytest.raises(AssertionError):
        broken(Overwriting).test_its_file_is_a_name_of_its_own()


def test_a_format_that_needs_a_step_is_found(tmp_path: Path) -> None:
    with pytest.raises(AttributeError):
        broken(OfRules).test_every_stage_is_reported("broken rules", tmp_path)


def test_a_format_that_writes_files_itself_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        broken(Writing).test_every_stage_is_reported("until test", tmp_path)


def test_the_bench_has_whole_findings(tmp_path: Path) -> None:
    view = view_at("hostile", tmp_path)
    assert view.broken == {}
    assert all(record is not None for _, record in view.steps)
    assert view.severity == "activated"
    assert len(STAGES) > 2 * len(FINDING_FILES)


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_the_bench_has_the_campaigns_that_it_names(name: str, tmp_path: Path) -> None:
    view = campaign_at(name, tmp_path)
    assert bool(view.broken) == ("broken" in name)
    assert (view.campaign is None) == (name in ("not finished", "nothing done", "broken"))
    assert bool(view.findings) == (name not in ("nothing found", "nothing done", "inconclusive", "not judged"))


def test_the_shipped_formats_are_plug_ins() -> None:
    shipped = {
        "github": GithubReport,
        "html": HtmlReport,
        "json": JsonReport,
        "junit": JunitReport,
        "markdown": MarkdownReport,
        "sarif": SarifReport,
        "text": TextReport,
    }
    assert {name: REPORTS.load(name) for name in REPORTS.targets()} == shipped
    with pytest.raises(ConfigError, match="did you mean 'html'"):
        REPORTS.load("htm")
