"""`riot ci` on the command line: what it refuses before anything runs, and what it writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from riot_bus.cli.main import make_app
from riot_bus.findings.known import KnownFindings
from riot_bus.findings.records import FindingRecord
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_testkit.reports import campaign_at
from tests.unit.chain.machine import LOGGED, SYSTEM, write_nominal


def ci(*words: object) -> Result:
    return CliRunner().invoke(make_app("ci"), ["ci", *map(str, words)])


def refused(*words: object) -> str:
    problem = ci(*words).exception
    assert isinstance(problem, ConfigError), problem
    return str(problem)


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "riot.toml").write_text(SYSTEM)
    return tmp_path


@pytest.mark.parametrize("mode", ["change", "batch", "prune"])
def test_what_is_wrong_is_told_before_anything_runs(mode: str, repository: Path) -> None:
    assert "no unit 'driv'" in refused(mode, "--unit", "driv")
    (repository / "riot-baseline.json").write_text("{")
    assert "riot-baseline.json:1: this is not JSON" in refused(mode)
    assert "cannot read the system file" in refused(mode, "--baseline", "none.json", "--system", "none.toml")
    assert not (repository / "riot-out").exists()


@pytest.mark.parametrize("mode", ["change", "batch"])
def test_reports_that_cannot_be_had_are_refused(mode: str, repository: Path) -> None:
    assert "did you mean 'junit'?" in refused(mode, "--report", "junt")
    (repository / "riot.toml").write_text(f"{SYSTEM}\n[unit.governor]\n")
    assert "2 units would write to 'junit=x.xml'" in refused(mode, "--report", "junit=x.xml")
    assert not (repository / "riot-out").exists()


def test_findings_are_not_kept_elsewhere(repository: Path) -> None:
    assert "in the folder of the baseline" in refused("batch", "--keep", repository.parent / "kept")


@pytest.mark.integration
def test_a_unit_that_does_not_start_fails_no_build_unless_it_is_strict(repository: Path) -> None:
    write_nominal(repository)
    (repository / "riot.toml").write_text(LOGGED.replace('["drive"]', '["false"]'))
    told = ci("change", "--minutes", 0.1, "--report", "github", "--report", "junit")
    assert told.exit_code == 0
    assert f"riot: not tested: drive: {repository / 'riot.toml'}: component 'drive' " in told.stderr
    assert "::warning title=riot::not tested: " in told.stdout
    assert "no new finding; 1 of 1 unit not tested" in told.stdout
    assert "there is no riot-baseline.json, so nothing is known" in told.stdout
    text = (repository / "riot-out/drive/riot.xunit.xml").read_text()
    assert 'type="environment"' in text
    assert ci("change", "--minutes", 0.1, "--strict").exit_code == 4
    found = ci("change", "--minutes", 0.1, "--format", "json")
    (unit,) = json.loads(found.stdout)["units"]
    assert unit["untested"].startswith(f"{repository / 'riot.toml'}: component 'drive' ")


def test_findings_are_accepted_by_their_folders(repository: Path) -> None:
    (repository / "riot-out/planner").mkdir(parents=True)
    view = campaign_at("finished", repository / "riot-out/planner")
    (folder,) = (one.directory for one in view.findings)
    (folder / "minimal.mcap").write_bytes(b"log")
    told = ci("accept", folder, "--note", "ticket 12", "--keep", "riot-findings")
    assert told.exit_code == 0, told.output
    first, last = told.stdout.splitlines()
    kept = f"riot-findings/findings/{folder.name}"
    assert first == f"added, note, kept in {kept}: IndexError in costmap.py:update"
    assert last == "written: riot-baseline.json; next, commit it"
    (entry,) = KnownFindings.load(repository / "riot-baseline.json").entries.values()
    assert (entry.title, entry.note, entry.log) == (FindingRecord.load(folder).signature, "ticket 12", kept)
    assert ci("accept", "riot-out").stdout == "nothing has changed\n"
    assert "no finding at 'none'" in refused("accept", "none")


def test_nothing_known_is_nothing_to_prune(repository: Path) -> None:
    told = ci("prune")
    assert told.exit_code == 0
    assert told.stdout == (
        "there is no riot-baseline.json, so nothing is known: every finding is new\n0 known findings\n"
    )
    assert json.loads(ci("prune", "--format", "json").stdout) == {"findings": []}


def test_a_workflow_is_written_and_not_twice(repository: Path) -> None:
    told = ci("init", "--github")
    assert told.stdout.startswith("written: .github/workflows/riot.yml\nnext, in the lines marked FILL IN")
    assert "a workflow exists already" in refused("init", "--github")
    assert ci("init", "--github", "--gitlab", "--force").exit_code == 0
    assert (repository / ".gitlab-ci.riot.yml").is_file()
