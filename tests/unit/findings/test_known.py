from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from riot_bus.findings.known import KnownFinding, KnownFindings, fingerprint_of, title_of
from riot_bus.findings.records import FindingRecord, ProportionRecord
from riot_bus.vocabulary.errors import ConfigError


def record(signature: str = "crash in planner: window: raise ValueError", **more: Any) -> FindingRecord:
    rate = ProportionRecord(value=0.75, low=0.2, high=1.0, count=3, total=4)
    known = {
        "id": "crash-planner-1f3a", "system": "rover", "system_file": "/site/riot.toml", "unit": "planner",
        "component": "planner", "monitor": "crash", "severity": "abort", "signature": signature, "rate": rate,
    }  # fmt: skip
    return FindingRecord.model_validate(known | more)


def entry(signature: str = "crash in planner: window: raise ValueError", **more: Any) -> KnownFinding:
    return KnownFinding.of(record(signature), since="2026-03-01 1a2b3c").model_copy(update=more)


def baseline(folder: Path, *entries: KnownFinding) -> KnownFindings:
    return KnownFindings(folder / "riot-baseline.json").updated(entries)


def written(path: Path, **changes: Any) -> Path:
    """Write a file whose only finding has some other values."""
    baseline(path.parent, entry()).save()
    document = json.loads((path.parent / "riot-baseline.json").read_text())
    document["findings"][0] |= changes
    path.write_text(json.dumps(document))
    return path


def test_a_title_is_the_signature_and_what_else_tells_findings_apart() -> None:
    finding = record()
    assert title_of(finding) == finding.signature
    assert title_of(finding.model_copy(update={"whole_system": True})) == f"{finding.signature} (whole system)"
    assert title_of(finding.model_copy(update={"id": "x-missing"})) == f"{finding.signature} (messages missing)"


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    one, two = entry(note="ticket 12 \u202e"), entry("hang of planner", fixed="2026-03-02", log="kept/x")
    path = baseline(tmp_path, one, two).save()
    found = KnownFindings.load(path)
    assert dict(found.entries) == {one.fingerprint: one, two.fingerprint: two}
    assert not found.missing
    assert one.fingerprint == fingerprint_of(record())
    assert (one.failed, one.trials, one.severity) == (3, 4, "abort")
    assert path.read_bytes().isascii()
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_a_file_is_the_same_whatever_the_order_and_grows_by_the_lines_of_one_entry(tmp_path: Path) -> None:
    one, two, three = (entry(f"crash in planner: {name}") for name in "abc")
    first = baseline(tmp_path, three, one).save().read_text().splitlines()
    assert baseline(tmp_path, one, three).save().read_text().splitlines() == first
    more = baseline(tmp_path, one, two, three).save().read_text().splitlines()
    rows = len(two.model_dump()) + 2
    assert len(more) == len(first) + rows
    assert [line for line in first if line not in more] == []


def test_notes_stay_when_entries_are_added(tmp_path: Path) -> None:
    before = baseline(tmp_path, entry(note="ticket 12"))
    after = before.updated([entry("hang of planner")])
    assert [each.note for each in after.of("planner")] == ["ticket 12", ""]


def test_a_missing_file_knows_nothing(tmp_path: Path) -> None:
    found = KnownFindings.load(tmp_path / "none.json")
    assert found.missing
    assert not found.entries


def test_those_that_are_fixed_come_first_and_other_units_are_left_out(tmp_path: Path) -> None:
    other = KnownFinding.of(record("crash in mapper", unit="mapper", component="mapper"))
    found = baseline(tmp_path, entry("a"), entry("b", fixed="2026-03-02"), other).of("planner")
    assert [each.title for each in found] == ["b", "a"]


@pytest.mark.parametrize(
    ("changes", "place", "words"),
    [
        ({"title": "another"}, "findings[0]", "fingerprint is not that of component and title"),
        ({"log": "../elsewhere"}, "findings[0]", "log leads out of the folder"),
        ({"log": "/etc"}, "findings[0]", "log leads out of the folder"),
        ({"failed": "many"}, "findings[0].failed", "valid integer"),
        ({"ticket": 12}, "findings[0].ticket", "Extra inputs"),
        ({"note": "x" * 20_001}, "findings[0].note", "at most 20000 characters"),
    ],
)
def test_an_entry_that_cannot_be_used_is_named(changes: dict[str, Any], place: str, words: str, tmp_path: Path) -> None:
    path = written(tmp_path / "b.json", **changes)
    with pytest.raises(ConfigError, match=words) as problem:
        KnownFindings.load(path)
    assert problem.value.where == f"{path}: {place}"
    assert problem.value.hint


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "b.json:1: this is not JSON"),
        ('{\n<<<<<<< ours\n "version": 1\n}', "b.json:2: this is not JSON"),
        ("[" * 100_000, "b.json: this is not JSON"),
        ("9" * 5_000, "b.json: this is not JSON"),
        ("[]", "b.json: Input should be a valid dictionary"),
        ('{"version": 2}', "b.json: version: Input should be 1"),
    ],
)
def test_a_file_that_is_none_is_told_with_its_line(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "b.json"
    path.write_text(text)
    with pytest.raises(ConfigError) as problem:
        KnownFindings.load(path)
    assert words in str(problem.value)
    assert ("a merge has left its marks" in str(problem.value)) == ("<<<" in text)


def test_the_same_finding_twice_is_an_error(tmp_path: Path) -> None:
    path = written(tmp_path / "b.json")
    document = json.loads(path.read_text())
    path.write_text(json.dumps({"version": 1, "findings": document["findings"] * 2}))
    with pytest.raises(ConfigError, match="the same finding twice"):
        KnownFindings.load(path)


def test_what_is_no_file_and_what_is_too_large_are_errors(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no regular file"):
        KnownFindings.load(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigError, match="no regular file"):
        KnownFindings.load(tmp_path / "pipe")
    path = tmp_path / "b.json"
    with path.open("wb") as stream:
        stream.truncate((16 << 20) + 1)
    with pytest.raises(ConfigError, match=f"more than {16 << 20} bytes"):
        KnownFindings.load(path)
    with pytest.raises(ConfigError, match="cannot write the baseline"):
        KnownFindings(tmp_path / "none" / "b.json").save()


def test_a_log_is_found_beside_the_file_and_not_where_a_link_leads(tmp_path: Path) -> None:
    inside, outside = tmp_path / "repo" / "kept" / "x", tmp_path / "outside"
    for folder in (inside, outside):
        folder.mkdir(parents=True)
        record().save(folder)
    (tmp_path / "repo" / "link").symlink_to(outside)
    known = KnownFindings(tmp_path / "repo" / "riot-baseline.json")
    assert known.folder_of(entry(log="kept/x")) == tmp_path / "repo" / "kept" / "x"
    assert known.folder_of(entry(log="kept/none")) is None
    assert known.folder_of(entry()) is None
    with pytest.raises(ConfigError, match="log leads out"):
        known.folder_of(entry(log="link"))


def test_what_is_known_is_told_in_a_few_words() -> None:
    assert entry().told == "since 2026-03-01 1a2b3c"
    assert entry(note="ticket 12").told == "since 2026-03-01 1a2b3c (ticket 12)"
    assert entry(fixed="2026-03-02").told == "was fixed 2026-03-02"
    assert entry(since="").told == "since some time"


def test_a_text_that_is_no_unicode_is_known_all_the_same(tmp_path: Path) -> None:
    odd = record().model_copy(update={"signature": "crash: \ud800"})
    path = baseline(tmp_path, KnownFinding.of(odd)).save()
    assert fingerprint_of(odd) in KnownFindings.load(path).entries
