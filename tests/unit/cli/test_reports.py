"""`riot report` in any format, also in one of another package."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner, Result

from riot_bus.campaign.store import TrialStore
from riot_bus.cli.main import make_app
from riot_bus.findings.known import KnownFinding, KnownFindings
from riot_bus.plugins import REPORTS
from riot_bus.report.campaign_view import load_campaign
from riot_bus.report.finding_view import load
from riot_bus.report.text import summary
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.trial import Outcome, Verdict, Violation
from riot_bus_testkit.reports import campaign_at, view_at

PAGE = (Path(__file__).parents[3] / "docs" / "findings.md").read_text(encoding="utf-8")
(CSV,) = re.findall(r"^```python\n(class CsvReport.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = tmp_path / "finding"
    found.mkdir()
    view_at("until activate", found)
    return found


def report(folder: Path, *words: str) -> Result:
    return CliRunner().invoke(make_app("report"), ["report", str(folder), *words])


def test_a_page_is_written_unless_asked_otherwise(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("jinja2")
    assert report(folder).stdout == f"{folder / 'report.html'}\n"
    other = tmp_path / "other.html"
    assert report(folder, "-o", str(other)).stdout == f"{other}\n"
    assert other.read_bytes() == (folder / "report.html").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["finding", "other.html"]


def test_text_and_json_go_to_stdout(folder: Path, tmp_path: Path) -> None:
    before = sorted(folder.iterdir())
    assert report(folder, "--format=text").stdout == summary(folder) + "\n"
    told = json.loads(report(folder, "--format=json").stdout)
    assert (told["severity"], told["next"], told["unusable"]) == ("activated", None, {})
    assert told["steps"]["rules"]["text"] == "/map:x < 0"
    assert sorted(folder.iterdir()) == before
    file = tmp_path / "finding.txt"
    assert report(folder, "--format=text", "--out", str(file)).stdout == f"{file}\n"
    assert file.read_text() == summary(folder) + "\n"


def test_json_says_what_is_missing(tmp_path: Path) -> None:
    view_at("broken rules", tmp_path)
    told = json.loads(report(tmp_path, "--format=json").stdout)
    assert told["steps"]["rules"] is None
    assert list(told["unusable"]) == ["rule.json"]
    assert told["next"] == "rules"


def test_a_format_of_others_as_on_the_page(folder: Path, plugin_package: Callable[..., str]) -> None:
    plugin_package(CSV, "riot_bus.reports", csv="CsvReport")
    assert report(folder, "--format=csv").stdout == f"{folder / 'report.csv'}\n"
    assert (folder / "report.csv").read_text() == "id,severity\nplanner-crash-1f3a,activated\n"


@pytest.mark.parametrize(("form", "name"), [("junit", "riot.xunit.xml"), ("sarif", "riot.sarif")])
def test_a_campaign_is_written_into_its_folder(form: str, name: str, tmp_path: Path) -> None:
    view = campaign_at("several", tmp_path)
    assert report(tmp_path, f"--format={form}").stdout == f"{tmp_path / name}\n"
    assert (tmp_path / name).read_text() == REPORTS.load(form)().render_campaign(view)


@pytest.mark.parametrize("form", ["github", "markdown"])
def test_a_campaign_goes_to_stdout(form: str, tmp_path: Path) -> None:
    view = campaign_at("several", tmp_path)
    content = REPORTS.load(form)().render_campaign(view)
    assert report(tmp_path, f"--format={form}").stdout_bytes == (content if form == "github" else content.encode())


def test_a_format_of_campaigns_takes_one_finding(folder: Path) -> None:
    told = report(folder, "--format=junit")
    assert told.stdout == f"{folder / 'riot.xunit.xml'}\n"
    assert (folder / "riot.xunit.xml").read_text().count("<testcase ") == 1
    assert "1 finding of planner" in report(folder, "--format=github").stdout
    assert report(folder, "--format=markdown").stdout.startswith("\n### `planner-crash-1f3a` (activated)\n")


def test_what_a_baseline_knows_does_not_count(folder: Path, tmp_path: Path) -> None:
    entry = KnownFinding.of(load(folder).finding, since="2026-03-01", note="ticket 12")
    path = KnownFindings(tmp_path / "known.json").updated([entry]).save()
    report(folder, "--format=junit", "--baseline", str(path))
    (case,) = ElementTree.parse(folder / "riot.xunit.xml").iter("testcase")
    assert [(child.tag, child.attrib.get("type")) for child in case] == [("skipped", "known")]
    for words, told in (
        (("--format=junit", "-b", "none.json"), "there is no such baseline"),
        (("--format=text", "-b", str(path)), "does not tell which findings are known"),
    ):
        problem = report(folder, *words).exception
        assert isinstance(problem, ConfigError)
        assert told in str(problem)


def test_formats_of_findings_take_an_output_folder_with_one(tmp_path: Path) -> None:
    campaign_at("finished", tmp_path)
    only = tmp_path / "findings" / "planner-crash-1f3a"
    assert report(tmp_path, "--format=text").stdout == summary(only) + "\n"
    (tmp_path / "findings" / "two").mkdir()
    view_at("until test", tmp_path / "findings" / "two")
    problem = report(tmp_path, "--format=text").exception
    assert isinstance(problem, ConfigError)
    assert "2 findings in" in str(problem)


def test_the_summary_of_a_job_is_added_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign_at("finished", tmp_path)
    file = tmp_path / "summary.md"
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(file))
    for _ in range(2):
        assert "::notice title=riot::" in report(tmp_path, "--format=github").stdout
    assert file.read_text().count("## riot: 1 finding in 120 trials of planner\n") == 2
    report(tmp_path, "--format=junit")
    assert file.read_text().count("## riot: ") == 2
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path))
    problem = report(tmp_path, "--format=github").exception
    assert isinstance(problem, ConfigError)
    assert "GITHUB_STEP_SUMMARY" in str(problem)


def findings(folder: Path, *words: str) -> Result:
    return CliRunner().invoke(make_app("findings"), ["findings", str(folder), *words])


def test_findings_are_listed_the_worst_first_and_a_broken_one_is_told(tmp_path: Path) -> None:
    campaign_at("a broken finding", tmp_path)
    told = findings(tmp_path)
    assert told.exit_code == 0
    assert told.stdout.startswith(summary(tmp_path / "findings" / "1") + "\n")
    assert "findings/planner-crash-1f3a/finding.json cannot be used" in told.stderr
    (record,) = json.loads(findings(tmp_path, "--format=json").stdout)
    assert (record["folder"], record["id"]) == (str(tmp_path / "findings" / "1"), "planner-crash-1f3a")


def test_two_findings_have_a_line_between_them(tmp_path: Path) -> None:
    campaign_at("several", tmp_path)
    first, second, third = (summary(one.directory) for one in load_campaign(tmp_path).findings)
    assert findings(tmp_path).stdout.startswith(f"{first}\n\n{second}\n\n{third}\n")
    assert "30 injections: " in findings(tmp_path).stdout


@pytest.mark.parametrize("name", ["nothing found", "inconclusive", "not judged"])
def test_no_finding_is_said_with_what_that_rests_on(name: str, tmp_path: Path) -> None:
    view = campaign_at(name, tmp_path)
    assert view.campaign
    lines = findings(tmp_path).stdout.splitlines()
    assert lines[0] == view.verdict
    assert "no finding in 120 trials of planner" in lines[0]
    assert lines[1:-5] == view.campaign.doubts
    assert lines[-5:-3] == [
        "not confirmed: hang of planner (0 of 4 fresh trials)",
        "not told: silent: nothing on /plan: nominal trials show the same",
    ]


def test_a_campaign_that_has_not_ended_is_told_as_that(tmp_path: Path) -> None:
    campaign_at("not finished", tmp_path)
    assert findings(tmp_path).stdout.endswith("\n\nnot finished: 1 finding of planner so far\n")


@pytest.mark.parametrize("where", ["", "none"])
def test_a_folder_without_a_campaign_is_an_error(where: str, tmp_path: Path) -> None:
    problem = findings(tmp_path / where).exception
    assert isinstance(problem, ConfigError)
    assert "there are neither findings nor an ended campaign here" in str(problem)


@pytest.mark.parametrize(("asked", "words"), [("junt", "did you mean 'junit'?"), ("html", "is of one finding")])
@pytest.mark.parametrize("command", ["test", "analyze"])
def test_a_report_that_cannot_be_had_is_refused_before_any_trial(
    command: str, asked: str, words: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    arguments = [command, "--system", str(tmp_path / "none.toml"), "--out", str(out), "--report", asked]
    problem = CliRunner().invoke(make_app(command), arguments).exception
    assert isinstance(problem, ConfigError)
    assert words in str(problem)
    assert not out.exists()


def test_a_system_that_cannot_be_read_is_an_error_in_its_report(tmp_path: Path) -> None:
    file = tmp_path / "build" / "pkg" / "riot.xunit.xml"
    arguments = ["test", "--system", str(tmp_path / "none.toml"), "--out", str(tmp_path), "--report", f"junit={file}"]
    assert isinstance(CliRunner().invoke(make_app("test"), arguments).exception, ConfigError)
    assert 'errors="1"' in file.read_text()
    assert "cannot read the system file" in file.read_text()


def test_what_cannot_be_done_is_named(folder: Path, tmp_path: Path) -> None:
    unknown = report(folder, "--format=pdf").exception
    assert isinstance(unknown, ConfigError)
    assert "unknown report format 'pdf'" in str(unknown)
    nowhere = report(folder, "--format=text", "-o", str(tmp_path / "no" / "x")).exception
    assert isinstance(nowhere, ConfigError)
    assert "cannot write the report" in str(nowhere)


def test_trials_are_listed_and_written_as_parquet(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    store = TrialStore(tmp_path / "trials" / TrialStore.NAME)
    store.put("a", Outcome(Verdict.FAIL, (Violation("crash", "u", "crash in u"),), 0.25, "why"))
    store.put("b", Outcome(Verdict.PASS))

    def trials(*words: object) -> Result:
        return CliRunner().invoke(make_app("trials"), ["trials", *map(str, words)])

    rows = [json.loads(line) for line in trials(tmp_path).stdout.splitlines()]
    assert [(row["key"], row["verdict"], row["signatures"]) for row in rows] == [
        ("a", "fail", "crash in u"),
        ("b", "pass", ""),
    ]
    file = tmp_path / "trials.parquet"
    assert trials(tmp_path, "--out", file).stdout == f"{file}\n"
    assert parquet.read_table(file).to_pylist() == rows
    for words, why in (
        ((tmp_path, "-o", file), "exists"),
        ((tmp_path, "-o", "a.csv"), "parquet"),
        (("none",), "no trials"),
    ):
        problem = trials(*words).exception
        assert isinstance(problem, ConfigError)
        assert why in str(problem)
