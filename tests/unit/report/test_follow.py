from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps.analyze import analyze_all
from riot_bus.chain.steps.robustness import test_unit as run_campaign
from riot_bus.chain.steps.robustness import tested as known_findings
from riot_bus.events import CampaignFinished, CampaignStarted, FindingReplayed, FindingWritten, RunEvent
from riot_bus.findings.known import KnownFinding, KnownFindings
from riot_bus.findings.records import FindingRecord
from riot_bus.report.follow import AskedReport, ReportFollower, asked_report, reports_of
from riot_bus.report.junit import JunitReport
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from tests.unit.chain.machine import SYSTEM, Machine, never_hangs


class Bench:
    """A campaign on a machine, whose JUnit file is looked at whenever something happens."""

    def __init__(self, folder: Path, *formats: str) -> None:
        self.folder, self.out, self.xml = folder, folder / "out", folder / "build" / "pkg" / "riot.xunit.xml"
        (folder / "riot.toml").write_text(SYSTEM)
        asked = [asked_report(each, out=self.out) for each in (f"junit={self.xml}", *formats)]
        self.said: list[str | bytes] = []
        self.follower = ReportFollower(asked, self.out, self.said.append)
        self.seen: list[tuple[str, dict[str, str]]] = []

    def look(self, event: RunEvent) -> None:
        self.seen.append((type(event).__name__, self.cases()))

    def cases(self) -> dict[str, str]:
        cases = ElementTree.fromstring(self.xml.read_text()).iter("testcase")
        ends = ((case, [child.tag for child in case if child.tag != "system-out"]) for case in cases)
        return {case.attrib["name"]: tags[0] if tags else "passed" for case, tags in ends}

    def workspace(self, **machine: object) -> Workspace:
        made = Machine(self.folder, **machine)  # type: ignore[arg-type]
        return Workspace(self.folder / "riot.toml", self.out, listeners=[self.follower, self.look], runners=made)

    def after(self, kind: type[RunEvent]) -> list[dict[str, str]]:
        return [cases for name, cases in self.seen if name == kind.__name__]


UNKNOWN = {"nominal log": "skipped", "campaign": "error"}


def test_a_campaign_is_reported_as_it_goes_on(tmp_path: Path) -> None:
    one = Bench(tmp_path, "sarif", "github")
    with one.follower, one.workspace() as workspace:
        assert one.cases() == UNKNOWN
        (folder,) = run_campaign(workspace, "drive", trials=30, seconds=None, covered=False)
    signature = FindingRecord.load(folder).signature
    ended = {"nominal log": "passed", "campaign": "passed", signature: "failure"}
    assert one.after(CampaignStarted) == [UNKNOWN]
    assert one.after(FindingWritten) == [UNKNOWN | {signature: "failure"}]
    assert one.after(CampaignFinished) == [ended] == [one.cases()]
    (result,) = json.loads((one.out / "riot.sarif").read_text())["runs"][0]["results"]
    assert result["ruleId"] == "hang"
    (said,) = one.said
    assert isinstance(said, bytes)
    assert said.startswith(b"::error file=")
    assert b"::notice title=riot::1 finding in" in said
    assert [path.name for path in one.xml.parent.iterdir()] == ["riot.xunit.xml"], "no half of a file is left"


def test_findings_that_are_there_already_are_taken_through_the_chain(tmp_path: Path) -> None:
    first = Bench(tmp_path)
    with first.follower, first.workspace() as workspace:
        folders = run_campaign(workspace, "drive", trials=30, seconds=None, covered=False)
    one = Bench(tmp_path)
    with one.follower, one.workspace() as workspace:
        assert one.cases() == UNKNOWN, "whether what is there is of this code is not known yet"
        assert known_findings(workspace, "drive") == folders
        analyze_all(workspace, folders)
    assert one.cases() == first.cases()
    begun = [cases for name, cases in one.seen if name == "StepStarted"]
    assert begun[0] == first.cases(), "a kill in the first step leaves what the campaign has found"
    assert "fails when" not in first.xml.read_text()
    assert "drive hangs when " in one.xml.read_text()


def test_a_clean_campaign_is_one(tmp_path: Path) -> None:
    one = Bench(tmp_path)
    with one.follower, one.workspace(fails=never_hangs) as workspace:
        run_campaign(workspace, "drive", trials=6, seconds=None, covered=False)
    assert one.cases() == {"nominal log": "passed", "campaign": "passed"}


def test_an_older_campaign_in_the_folder_is_not_taken_for_this_one(tmp_path: Path) -> None:
    old = Bench(tmp_path)
    with old.follower, old.workspace() as workspace:
        (folder,) = run_campaign(workspace, "drive", trials=30, seconds=None, covered=False)
    FindingRecord.load(folder).model_copy(update={"fingerprint": "other"}).save(folder)
    one = Bench(tmp_path)

    def fail() -> None:
        with one.follower:
            one.follower(CampaignStarted("drive", "this"))
            raise EnvironmentFaultError("port 7447 is in use")

    with pytest.raises(EnvironmentFaultError):
        fail()
    assert one.cases() == UNKNOWN | {FindingRecord.load(folder).signature: "skipped"}


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (EnvironmentFaultError("port 7447 is in use"), "not finished (port 7447 is in use): 0 findings so far"),
        (KeyboardInterrupt(), "not finished (interrupted): 0 findings so far"),
        (ZeroDivisionError("x\x1b"), "not finished (ZeroDivisionError: x\\x1b): 0 findings so far"),
    ],
)
def test_why_the_work_ended_is_told(error: BaseException, told: str, tmp_path: Path) -> None:
    one = Bench(tmp_path, "github")
    with pytest.raises(type(error)), one.follower:
        raise error
    assert told in one.xml.read_text()
    assert one.said == [f"::error title=riot::{told}\n".encode()]


def test_the_summary_of_a_job_is_added_to_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    summary = tmp_path / "summary.md"
    summary.write_text("before\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    one = Bench(tmp_path, "github")
    with one.follower, one.workspace(fails=never_hangs) as workspace:
        run_campaign(workspace, "drive", trials=6, seconds=None, covered=False)
    assert summary.read_text().startswith("before\n## riot: no finding in ")
    assert summary.read_text().count("## riot") == 1


def test_a_format_is_written_where_it_was_asked_for(tmp_path: Path) -> None:
    assert asked_report("junit", out=tmp_path).path == tmp_path / "riot.xunit.xml"
    assert asked_report("junit=a=b.xml", out=tmp_path).path == Path("a=b.xml")
    assert asked_report("github", out=tmp_path).path is None
    assert asked_report("markdown=x.md", out=tmp_path).path == Path("x.md")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("junt", "did you mean 'junit'?"),
        ("html", "report format 'html' is of one finding"),
        ("junit=", "names no file"),
        ("", "unknown report format ''"),
    ],
)
def test_what_cannot_be_had_is_refused(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as problem:
        asked_report(text, out=tmp_path)
    assert words in str(problem.value)
    assert problem.value.hint


def test_a_file_that_cannot_be_written_is_told_before_anything_runs(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    follower = ReportFollower([AskedReport(JunitReport(), tmp_path / "file" / "x.xml")], tmp_path, print)
    with pytest.raises(ConfigError, match="cannot write the report"), follower:
        pytest.fail("the work has begun")


def test_without_reports_nothing_is_written_or_said(tmp_path: Path) -> None:
    said: list[object] = []
    with ReportFollower([], tmp_path, said.append) as follower:
        follower(CampaignStarted("drive", "x"))
    assert said == list(tmp_path.iterdir()) == []


def test_known_findings_do_not_count_and_what_was_played_again_is_told(tmp_path: Path) -> None:
    one = Bench(tmp_path)
    with one.follower, one.workspace() as workspace:
        (folder,) = run_campaign(workspace, "drive", trials=30, seconds=None, covered=False)
    entry = KnownFinding.of(FindingRecord.load(folder), since="2026-03-01")
    known = KnownFindings(tmp_path / "b.json").updated([entry])
    asked = [asked_report("markdown", out=one.out), asked_report("github", out=one.out)]
    said: list[Any] = []
    with ReportFollower(asked, one.out, said.append, known=known) as follower:
        follower(FindingReplayed(str(folder), "hang", "fixed", "fixed (known): hang", 0, 3))
        follower(FindingReplayed(str(folder), "hang", "still failing", "", 3, 3))
    page, commands = said
    assert "known: since 2026-03-01" in str(page)
    assert str(page).count("fixed (known): hang") == 1
    assert isinstance(commands, bytes)
    assert commands.startswith(b"::notice title=riot::1 known finding in ")
    assert commands.endswith(b"%0Afixed (known): hang\n")


@pytest.mark.parametrize(("lenient", "level"), [(True, "warning"), (False, "error")])
def test_surroundings_that_fail_are_an_error_unless_they_are_excused(
    tmp_path: Path, *, lenient: bool, level: str
) -> None:
    said: list[Any] = []
    follower = ReportFollower([asked_report("github", out=tmp_path)], tmp_path, said.append, lenient=lenient)
    with pytest.raises(EnvironmentFaultError), follower:
        raise EnvironmentFaultError("no port")
    assert bytes(said[0]).startswith(f"::{level} title=riot::not ".encode())
    said.clear()
    follower = ReportFollower([asked_report("github", out=tmp_path)], tmp_path, said.append, lenient=lenient)
    with pytest.raises(ConfigError), follower:
        raise ConfigError("no such unit")
    assert bytes(said[0]).startswith(b"::error title=riot::not finished (no such unit)")


def test_each_unit_has_its_reports(tmp_path: Path) -> None:
    folders = {"planner": tmp_path / "planner", "a/b": tmp_path / "a_b-1f3a"}
    texts = ["junit", "markdown=x/{unit}.md"]
    assert reports_of(texts, folders) == {
        "planner": ["junit", "markdown=x/planner.md"], "a/b": ["junit", "markdown=x/a_b-1f3a.md"]
    }  # fmt: skip
    assert reports_of(["junit=x.xml"], {"planner": tmp_path}) == {"planner": ["junit=x.xml"]}
    with pytest.raises(ConfigError, match=r"2 units would write to 'junit=x\.xml'") as problem:
        reports_of(["junit=x.xml"], folders)
    assert "{unit}" in str(problem.value.hint)
    with pytest.raises(ConfigError, match="unknown report format"):
        reports_of(["junt"], folders)
