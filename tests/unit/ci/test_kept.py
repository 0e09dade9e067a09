from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.chain.base.logs import FailingLog
from riot_bus.chain.steps.reproduce import Reproduction, play_again
from riot_bus.ci.kept import LARGEST, keep_finding, take_up
from riot_bus.events import FindingWritten
from riot_bus.findings.records import FindingRecord, MinimalRecord
from riot_bus.report.campaign_view import load_campaign
from riot_bus.testing.regression import reproduce_finding
from tests.unit.chain.machine import OTHER, SYSTEM, Machine, bench, command, write_finding, write_minimal

FAILS = Reproduction("still failing", 3, 3, "minimal.mcap", "still busy")


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_what_it_takes_to_play_it_again_is_kept_and_leads_nowhere(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    (one.folder / "rule.json").write_text("{}")
    kept = keep_finding(one.folder, tmp_path / "riot-findings")
    assert kept == tmp_path / "riot-findings" / "findings" / one.folder.name
    assert names(kept) == {
        "finding.json", "minimal.json", "minimal.mcap", "reproduce.sh", "riot_test_hang_drive_1.py"
    }  # fmt: skip
    texts = [path.read_bytes() for path in kept.parents[1].rglob("*") if path.is_file()]
    assert not any(str(tmp_path).encode() in text for text in texts)
    assert json.loads((kept / "finding.json").read_text())["system_file"] == "../../../riot.toml"
    assert (kept.parents[1] / ".gitignore").read_text() == "/trials/\n"


def test_a_kept_finding_is_played_where_its_repository_was_moved(tmp_path: Path) -> None:
    before, after = tmp_path / "before", tmp_path / "after"
    before.mkdir()
    one = bench(before)
    write_minimal(one)
    keep_finding(one.folder, before / "riot-findings")
    before.rename(after)
    kept = after / "riot-findings" / "findings" / one.folder.name
    record = FindingRecord.load(kept)
    assert Path(record.system_file) == after / "riot.toml"
    found = reproduce_finding(kept, root=after, runners=Machine(after))
    assert (found.answer, found.log) == ("still failing", "minimal.mcap")
    assert [view.finding.id for view in load_campaign(after / "riot-findings").findings] == [record.id]


def test_the_nominal_run_is_kept_with_what_only_nominal_trials_tell(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    nominal, kept = one.workspace.nominal_log(), tmp_path / "kept" / "nominal.mcap"
    record = FindingRecord.load(one.folder)
    record.model_copy(update={"monitor": "crash"}).save(one.folder)
    keep_finding(one.folder, kept.parent)
    assert not kept.exists()
    record.save(one.folder)
    keep_finding(one.folder, kept.parent)
    assert kept.read_bytes() == nominal.read_bytes()
    kept.write_bytes(b"of another finding")
    keep_finding(one.folder, kept.parent)
    assert kept.read_bytes() == b"of another finding"
    kept.unlink()
    with nominal.open("ab") as stream:
        stream.truncate(LARGEST + 1)
    keep_finding(one.folder, kept.parent)
    assert not kept.exists()


def test_the_failing_log_is_kept_where_there_is_no_minimal_one(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_finding(one, [command("step", -5.0)], {})
    kept = keep_finding(one.folder, tmp_path / "riot-findings")
    assert kept is not None
    assert "failure.mcap" in names(kept)
    assert not MinimalRecord.exists(kept)


@pytest.mark.parametrize("large", [True, False])
def test_a_log_that_is_too_large_or_gone_is_not_kept(tmp_path: Path, *, large: bool) -> None:
    one = bench(tmp_path)
    write_finding(one, [command("step", -5.0)], {})
    if large:
        with (one.folder / "failure.mcap").open("ab") as stream:
            stream.truncate(LARGEST + 1)
    else:
        (one.folder / "failure.mcap").unlink()
    assert keep_finding(one.folder, tmp_path / "kept") is None
    assert not (tmp_path / "kept").exists()


def test_a_finding_is_taken_up_as_one_of_this_code_and_what_was_learnt_is_put_aside(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    old = FindingRecord.load(one.folder).model_copy(update={"fingerprint": "old", "fixed_in": "older"})
    old.save(one.folder)
    (one.folder / "rule.json").write_text("{}")
    assert take_up(one.workspace, one.folder, FAILS, evidence=False) == one.folder
    record = FindingRecord.load(one.folder)
    assert (record.fingerprint, record.fixed_in) == (one.workspace.fingerprint, "")
    assert record.rate is not None
    assert (record.rate.count, record.rate.total, record.details) == (3, 3, ("still busy",))
    assert (record.messages, record.modified) == (1, 1)
    log = FailingLog.load(one.folder / "failure.mcap", registry=one.workspace.context.registry)
    assert len(log.originals) == 1
    assert names(one.folder / "earlier" / "old") >= {"rule.json", "minimal.mcap", "finding.json"}
    assert not MinimalRecord.exists(one.folder)
    assert [event.id for event in one.told(FindingWritten)] == [one.folder.name]
    assert play_again(one.workspace, one.folder).answer == "still failing"


def test_one_that_is_there_already_is_left_as_it_is(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    kept = keep_finding(one.folder, tmp_path / "kept")
    assert kept is not None
    now = FindingRecord.load(one.folder).model_copy(update={"fingerprint": one.workspace.fingerprint})
    now.save(one.folder)
    before = {path: path.read_bytes() for path in one.folder.iterdir()}
    assert take_up(one.workspace, kept, FAILS, evidence=True) == one.folder
    assert {path: path.read_bytes() for path in one.folder.iterdir()} == before


def test_one_that_fails_otherwise_gets_a_folder_of_its_own(tmp_path: Path) -> None:
    one = bench(tmp_path, SYSTEM, other=lambda case: True)
    write_minimal(one)
    found = play_again(one.workspace, one.folder)
    assert (found.answer, found.others) == ("failing otherwise", (OTHER,))
    folder = take_up(one.workspace, one.folder, found, other=OTHER, evidence=False)
    record = FindingRecord.load(folder)
    assert folder != one.folder
    assert (record.id, record.signature, record.occurrences) == (folder.name, OTHER.signature, 3)
    assert FindingRecord.exists(one.folder)


def test_the_name_of_a_finding_is_that_of_its_folder_not_what_its_file_says(tmp_path: Path) -> None:
    one = bench(tmp_path)
    write_minimal(one)
    kept = keep_finding(one.folder, tmp_path / "kept")
    assert kept is not None
    FindingRecord.load(kept).model_copy(update={"id": "../../../away"}).save(kept)
    assert take_up(one.workspace, kept, FAILS, evidence=False) == one.folder
    assert not (tmp_path / "away").exists()
