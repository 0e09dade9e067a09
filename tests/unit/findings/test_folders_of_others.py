"""Folders of findings that somebody else has made: links, pipes, and JSON that nobody would write."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from riot_bus.campaign.store import TrialStore
from riot_bus.chain.base.workspace import Workspace, open_finding
from riot_bus.ci.ci import _tidy
from riot_bus.ci.ci_baseline import accept
from riot_bus.ci.kept import keep_finding
from riot_bus.findings.known import KnownFindings
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.report.campaign_view import load_campaign
from riot_bus.report.finding_view import evidence_files, load
from riot_bus.report.formats import write_file
from riot_bus.report.junit import JunitReport
from riot_bus.report.location import find_place, unit_place
from riot_bus.report.page import write_report
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_fleet.scan import ScanRule
from tests.unit.chain.machine import Bench, bench, write_minimal, write_rule

KEY = "PRIVATE KEY OF THE VICTIM 4711"


@pytest.fixture
def one(tmp_path: Path) -> Bench:
    made = bench(tmp_path)
    write_minimal(made)
    write_rule(made)
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "id_rsa").write_text(KEY)
    (made.folder / "evidence").mkdir()
    return made


FOLDERS = ["evidence", "region"]
PLACES = ["failure.mcap", "minimal.mcap", "rule.json", "finding.json", *FOLDERS]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_no_command_opens_what_is_not_in_the_folder(one: Bench, tmp_path: Path, place: str, kind: str) -> None:
    path = one.folder / place
    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(tmp_path / "home" / ("" if place in FOLDERS else "id_rsa"))
    known = KnownFindings.load(tmp_path / "riot-baseline.json")
    ways: list[Callable[[], object]] = [
        lambda: open_finding(one.folder),
        lambda: load(one.folder),
        lambda: write_report(one.folder),
        lambda: keep_finding(one.folder, tmp_path / "kept"),
        lambda: accept(known, [one.folder], since="", keep=tmp_path / "kept"),
    ]
    if (one.folder / "finding.json").is_file():  # without it, it is the folder of a rule alone
        ways += [lambda: ScanRule(one.folder), lambda: ScanRule(one.folder / "region")]
    for way in ways:
        with pytest.raises(ConfigError):
            way()
    view = load_campaign(one.workspace.out)
    assert view.findings == ()
    write_file(JunitReport().render_campaign(view), tmp_path / "riot.xunit.xml")
    made = [each for each in tmp_path.rglob("*") if each.is_file() and not each.is_symlink() and each.name != "id_rsa"]
    assert not [each for each in made if KEY.encode() in each.read_bytes()]


def test_evidence_is_what_lies_in_the_folder(one: Bench, tmp_path: Path) -> None:
    """A program may have left anything there, so the rest is shown."""
    evidence = one.folder / "evidence"
    (evidence / "drive.stderr.txt").symlink_to(tmp_path / "home" / "id_rsa")
    (evidence / "drive.stdout.txt").write_text("it said this")
    (evidence / "again.txt").symlink_to("drive.stdout.txt")
    (evidence / "lost.txt").symlink_to(tmp_path / "none")
    os.mkfifo(evidence / "pipe.txt")
    assert [path.name for path in evidence_files(one.folder)] == ["again.txt", "drive.stdout.txt"]
    text = write_report(one.folder).read_text()
    assert text.count("it said this") == 2
    assert KEY not in text
    find_place(load(one.folder))


def test_a_finding_that_a_link_leads_to_is_none_of_the_campaign_s(
    one: Bench, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    shutil.copytree(one.folder, tmp_path / "home" / "x")
    (one.workspace.findings / "x").symlink_to(tmp_path / "home" / "x")
    assert [view.directory for view in load_campaign(one.workspace.out).findings] == [one.folder]
    assert "findings/x is left out: this link leads out" in caplog.text
    (tmp_path / "home" / "campaign.json").write_text("{}")
    (one.workspace.out / "campaign.json").symlink_to(tmp_path / "home" / "campaign.json")
    with pytest.raises(ConfigError, match="leads out of"):
        CampaignRecord.load(one.workspace.out)


@pytest.mark.parametrize(
    "name", ["nominal.mcap", "trials", "trials/trials.sqlite", "trials/trials.sqlite-wal", "trials/baselines"]
)
def test_no_work_begins_in_an_output_folder_with_links_out_of_it(one: Bench, tmp_path: Path, name: str) -> None:
    """SQLite would write its log over whatever a link beside the store leads to."""
    path = tmp_path / "theirs" / name
    path.parent.mkdir(parents=True)
    path.symlink_to(tmp_path / "home" / ("" if name == "trials" else "id_rsa"))
    with pytest.raises(ConfigError, match="leads out of"):
        Workspace(tmp_path / "riot.toml", tmp_path / "theirs", runners=one.machine)
    path.unlink()
    path.symlink_to(tmp_path / "home" / "none")  # nothing is made there either
    if name != "nominal.mcap":
        with pytest.raises(ConfigError, match="leads out of"):
            TrialStore(tmp_path / "theirs" / "trials" / TrialStore.NAME)
    assert [each.name for each in (tmp_path / "home").iterdir()] == ["id_rsa"]
    assert (tmp_path / "home" / "id_rsa").read_text() == KEY


def test_tidying_removes_nothing_behind_a_link(one: Bench, tmp_path: Path) -> None:
    for number in range(9):
        (tmp_path / "home" / f"photos-{number}").mkdir()
    earlier = one.folder / "earlier"
    earlier.symlink_to(tmp_path / "home")
    _tidy(one.workspace)
    earlier.unlink()
    earlier.mkdir()
    for number in range(9):
        (earlier / f"link-{number}").symlink_to(tmp_path / "home" / f"photos-{number}")
    _tidy(one.workspace)
    assert len(list((tmp_path / "home").iterdir())) == 10


@pytest.mark.parametrize("text", ["[" * 200_000, '{"a":' * 200_000, "nul", "\0", "{}"])
def test_what_is_no_record_is_an_error(one: Bench, text: str) -> None:
    (one.folder / "finding.json").write_text(text)
    with pytest.raises(ConfigError, match="cannot be used"):
        FindingRecord.load(one.folder)


def test_the_place_of_a_unit_is_looked_for_in_files_alone(one: Bench, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    record = FindingRecord.load(one.folder)
    for path in (str(tmp_path / "pipe"), "/dev/zero", str(tmp_path)):
        assert unit_place(record.model_copy(update={"system_file": path})).line == 1
