"""The shipped report formats hold what formats promise; broken ones are found out."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.plugins import REPORTS
from riot_bus.report.json_form import JsonReport
from riot_bus.report.page import HtmlReport
from riot_bus.report.text import TextReport
from riot_bus.testing.reports import FINDING_FILES, STAGES, ReportConformance, view_at
from riot_bus.vocabulary.errors import ConfigError

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")


class TestHtml(ReportConformance):
    report = HtmlReport
    markup = True


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


def broken(report):
    return type("Broken", (ReportConformance,), {"report": report, "markup": True})()


def test_a_format_that_lets_names_become_tags_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        broken(Raw).test_hostile_names_stay_text(tmp_path)


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


def test_the_shipped_formats_are_plug_ins() -> None:
    assert [REPORTS.load(name) for name in ("html", "json", "text")] == [HtmlReport, JsonReport, TextReport]
    with pytest.raises(ConfigError, match="did you mean 'html'"):
        REPORTS.load("htm")
