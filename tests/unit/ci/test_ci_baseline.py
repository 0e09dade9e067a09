from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest

from riot_bus.ci.ci_baseline import accept, check_keep, found_in, moment, prune
from riot_bus.ci.kept import LARGEST
from riot_bus.events import FindingReplayed
from riot_bus.findings.known import KnownFindings
from riot_bus.vocabulary.errors import ConfigError
from tests.unit.chain.machine import HANG, never_hangs
from tests.unit.chain.repository import Repository

WHEN = "2026-03-02 4d5e6f"


def found(repository: Repository) -> Path:
    (folder,) = (one.directory for one in repository.change().failures)
    return folder


def pruned(repository: Repository, *, update: bool = True) -> tuple[list[tuple[str, bool]], int]:
    """Return the answers, whether they are of what was fixed before, and the exit code."""
    result = prune(["drive"], repository.opened, out=repository.out, known=repository.known, when=WHEN)
    if update:
        result.known.save()
    return [(one.answer, one.back) for one in result.asked], result.exit_code(strict=True)


def test_a_finding_becomes_known_with_its_log_and_what_people_say(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    lines = repository.accept(found(repository), note="ticket 12", keep=tmp_path / "riot-findings")
    (entry,) = repository.known.entries.values()
    assert (entry.title, entry.since, entry.note, entry.fixed) == (HANG.signature, "2026-03-01", "ticket 12", "")
    assert entry.log.startswith("riot-findings/findings/hang-drive-")
    assert repository.known.folder_of(entry) is not None
    (line,) = lines
    assert line == f"added, note, kept in {tmp_path / entry.log}: hang of drive"


def test_what_people_wrote_stays(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    folder = found(repository)
    repository.accept(folder, note="ticket 12")
    before = (tmp_path / "riot-baseline.json").read_bytes()
    known, lines = accept(repository.known, [folder], since="2027-01-01")
    assert lines == []
    known.save()
    assert (tmp_path / "riot-baseline.json").read_bytes() == before
    assert repository.accept(folder, keep=tmp_path / "kept")[0].startswith("kept in ")
    (entry,) = repository.known.entries.values()
    assert (entry.note, entry.since) == ("ticket 12", "2026-03-01")


def test_what_is_accepted_is_open_again_and_what_is_added_by_itself_is_not(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    folder = found(repository)
    repository.accept(folder)
    repository.mark_fixed()
    assert accept(repository.known, [folder], since="x", reopen=False) == (repository.known, [])
    assert repository.accept(folder) == ["no longer fixed 2026-03-02: hang of drive"]
    (entry,) = repository.known.entries.values()
    assert entry.fixed == ""


def test_findings_are_kept_beside_the_baseline_alone(tmp_path: Path) -> None:
    known = KnownFindings(tmp_path / "repo" / "riot-baseline.json")
    check_keep(known, None)
    check_keep(known, tmp_path / "repo" / "kept")
    with pytest.raises(ConfigError, match="in the folder of the baseline"):
        check_keep(known, tmp_path / "kept")


def test_a_log_that_is_too_large_is_not_kept_and_that_is_told(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    folder = found(repository)
    with (folder / "failure.mcap").open("ab") as stream:
        stream.truncate(LARGEST + 1)
    (line,) = repository.accept(folder, keep=tmp_path / "kept")
    assert line == "added, not kept: no log of at most 8 MiB: hang of drive"


def test_findings_are_found_in_folders_of_one_of_a_unit_and_of_all(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    folder = found(repository)
    assert found_in([folder]) == found_in([repository.drive]) == found_in([repository.out]) == [folder]
    assert found_in([folder, repository.drive]) == [folder, folder]
    repository.commit(never_hangs)
    repository.change()
    for empty in (tmp_path / "none", repository.out):
        with pytest.raises(ConfigError, match="no finding at"):
            found_in([empty])


def test_what_fails_no_more_is_marked_and_marked_it_stays(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.accept(found(repository), keep=tmp_path / "kept")
    assert pruned(repository) == ([("still failing", False)], 0)
    repository.commit(never_hangs)
    assert pruned(repository, update=False) == ([("fixed", False)], 0)
    (entry,) = repository.known.entries.values()
    assert entry.fixed == ""
    assert pruned(repository) == ([("fixed", False)], 0)
    (entry,) = repository.known.entries.values()
    assert entry.fixed == WHEN
    before = repository.known
    assert pruned(repository) == ([("fixed", False)], 0)
    assert repository.known == before
    assert [event.answer for event in repository.events if isinstance(event, FindingReplayed)][-1] == "fixed"


def test_what_was_fixed_and_fails_again_is_an_error_and_keeps_its_mark(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.accept(found(repository), keep=tmp_path / "kept")
    repository.mark_fixed()
    assert pruned(repository) == ([("still failing", True)], 1)
    (entry,) = repository.known.entries.values()
    assert entry.fixed == "2026-03-02"
    lines = prune(["drive"], repository.opened, out=repository.out, known=repository.known, when=WHEN).lines()
    assert lines == [
        "failing again: drive: hang of drive (3 of 3 fresh trials failed so)", "1 known finding: 1 failing again"
    ]  # fmt: skip


def test_what_cannot_be_asked_is_told(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    folder = found(repository)
    repository.accept(folder)
    folder.rename(tmp_path / "lost")
    assert pruned(repository) == ([("cannot be run", False)], 4)
    (tmp_path / "lost").rename(folder)
    repository.fault = "no port"
    result = prune(["drive"], repository.opened, out=repository.out, known=repository.known, when=WHEN)
    (one,) = result.asked
    assert (one.answer, one.text) == ("cannot be run", "no port")
    assert (result.exit_code(strict=False), result.exit_code(strict=True)) == (0, 4)
    assert json.loads(json.dumps(result.to_json()))[0]["title"] == HANG.signature


def test_what_is_not_decided_keeps_its_entry(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.accept(found(repository))
    repository.commit(never_hangs, wrong=lambda case: case.seed == 0 and len(case.messages) < 60)
    assert pruned(repository) == ([("not decided", False)], 5)
    (entry,) = repository.known.entries.values()
    assert entry.fixed == ""


def test_nothing_known_starts_nothing(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.fault = "nobody should ask"
    result = prune(["drive"], repository.opened, out=repository.out, known=repository.known, when=WHEN)
    assert (result.asked, result.lines()) == ((), ["0 known findings"])


def test_a_moment_is_the_day_and_the_commit(tmp_path: Path) -> None:
    assert re.fullmatch(
        r"\d{4}-\d\d-\d\d 1a2b3c4d5e6f", moment(tmp_path, environment={"GITHUB_SHA": "1a2b3c4d5e6f7a8b"})
    )
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", moment(tmp_path, environment={}))
    git = ["git", "-C", str(tmp_path), "-c", "user.name=x", "-c", "user.email=x@x"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "x"], check=True)
    head = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout
    assert moment(tmp_path, environment={}).endswith(f" {head[:12]}")


def test_units_that_were_not_asked_for_are_named(tmp_path: Path) -> None:
    repository = Repository(tmp_path)
    repository.accept(found(repository))
    result = prune([], repository.opened, out=repository.out, known=repository.known, when=WHEN)
    assert result.lines() == ["0 known findings; those of drive were not asked"]
