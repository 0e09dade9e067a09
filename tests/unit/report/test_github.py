from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from riot_bus.findings.known import title_of
from riot_bus.findings.records import FindingRecord
from riot_bus.report.campaign_view import CampaignView, as_campaign, load_campaign
from riot_bus.report.finding_view import load
from riot_bus.report.github import GithubReport
from riot_bus.report.markdown import MarkdownReport
from riot_bus_testkit.reports import CAMPAIGNS, campaign_at, view_at
from tests.unit.report.test_campaign_view import several

COMMAND = re.compile(r"::(?P<name>[a-z]+) (?P<properties>[^:]*)::(?P<message>.*)")


def commands(view: CampaignView) -> list[tuple[str, dict[str, str], str]]:
    """Return commands as GitHub's runner reads them: name, properties, message."""
    found = []
    for line in GithubReport().render_campaign(view).decode().splitlines():
        match = COMMAND.fullmatch(line)
        assert match, line
        pairs = (part.partition("=")[::2] for part in match["properties"].split(","))
        properties = {key: unescaped(value, "%3A:", "%2C,", "%0D\r", "%0A\n", "%25%") for key, value in pairs}
        found.append((match["name"], properties, unescaped(match["message"], "%0D\r", "%0A\n", "%25%")))
    return found


def unescaped(text: str, *codes: str) -> str:
    for code in codes:
        text = text.replace(code[:3], code[3:])
    return text


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_each_line_is_a_command(name: str, tmp_path: Path) -> None:
    view = campaign_at(name, tmp_path)
    found = commands(view)
    assert len(found) == len(view.current) + 1
    assert {name for name, _, _ in found} <= {"error", "warning", "notice"}


def test_a_finding_is_an_annotation_of_its_line(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    folder = tmp_path / "findings" / "planner-crash-1f3a"
    FindingRecord.load(folder).model_copy(update={"severity": "abort"}).save(folder)
    (name, properties, message), (told, about, verdict) = commands(load_campaign(tmp_path))
    assert (name, properties) == (
        "error", {"file": "rover/riot.toml", "line": "1", "title": "IndexError in costmap.py:update"}
    )  # fmt: skip
    lines = message.splitlines()
    assert lines[0].startswith("planner crashes when /map:x < 0; ")
    assert lines[-1] == f"riot reproduce {folder}"
    assert (told, about, verdict) == ("notice", {"title": "riot"}, "1 finding in 120 trials of planner")


@pytest.mark.parametrize(
    ("name", "level"), [("nothing found", "notice"), ("inconclusive", "warning"), ("not finished", "warning")]
)
def test_how_the_campaign_ended_has_a_level(name: str, level: str, tmp_path: Path) -> None:
    assert commands(campaign_at(name, tmp_path))[-1][0] == level


def test_what_stopped_the_work_is_an_error(tmp_path: Path) -> None:
    campaign_at("nothing found", tmp_path)
    assert commands(load_campaign(tmp_path, problem="no route"))[-1][0] == "error"


def test_no_text_ends_a_command_or_begins_one(tmp_path: Path) -> None:
    view = view_at("until test", tmp_path)
    signature = "100 %, a:b,c=d\n::error::x\r##[error]y\u2028::stop-commands::z%0A"
    changes = {"signature": signature, "details": (signature,), "component": signature}
    view.finding.model_copy(update=changes).save(tmp_path)
    found = commands(as_campaign(load(tmp_path)))
    assert len(found) == 2
    (_, properties, message), _ = found
    assert set(properties) == {"file", "line", "title"}
    assert properties["title"] == ("100 %, a:b,c=d\\n::error::x\\r##[error]y\\u2028::stop-commands::z%0A")
    assert message.count("100 %, a:b,c=d\n::error::x") == 1, "details keep their line ends, as escapes"


def test_only_as_many_as_are_shown(tmp_path: Path) -> None:
    for number in range(12):
        folder = tmp_path / "findings" / str(number)
        folder.mkdir(parents=True)
        view_at("until test", folder)
    found = commands(load_campaign(tmp_path))
    assert len(found) == 11
    assert "2 findings without an annotation" in found[-1][2]


def test_the_summary_is_the_markdown(tmp_path: Path) -> None:
    view = campaign_at("finished", tmp_path)
    assert GithubReport().render_summary(view) == MarkdownReport().render_campaign(view)


def test_findings_that_are_known_get_no_annotation(tmp_path: Path) -> None:
    view = several(tmp_path)
    first, second, last = commands(replace(view, remarks=("fixed: x",)))
    assert [first[1]["title"], second[1]["title"]] == [title_of(one.finding) for one in view.failures]
    assert first[2].splitlines()[1] == "came back: was fixed 2026-03-02"
    assert last == ("notice", {"title": "riot"}, f"{view.verdict}\nfixed: x")


def test_surroundings_that_are_excused_are_a_warning(tmp_path: Path) -> None:
    view = load_campaign(tmp_path, finished=False, problem="no port", unit="planner", fingerprint="1f3a")
    assert commands(view)[-1][0] == "error"
    assert commands(replace(view, excused=True)) == [("warning", {"title": "riot"}, "not tested: no port")]
