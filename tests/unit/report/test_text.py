from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.findings.records import FieldsRecord, FindingRecord, MinimalRecord, ProportionRecord, RuleRecord
from riot_bus.report.format import clean, number, plural, seconds, share, value
from riot_bus.report.page import write_report
from riot_bus.report.text import summary, unchecked
from riot_bus.vocabulary.errors import ConfigError
from tests.unit.report.conftest import rover


def test_whole_chain(finding: Path) -> None:
    lines = summary(finding).splitlines()
    assert lines[0].startswith(
        "planner-crash-1f3a  [activated]  planner crashes when /map_updates:x * /map_updates:y < 0"
    )
    assert lines[0].endswith("10 of 10 replays failed again.")
    assert "  log       5\N{NO-BREAK SPACE}012 messages (38 modified) -> 1 needed" in lines
    assert lines[-1] == f"  again     riot reproduce {finding}"
    assert len(lines) < 12


def test_what_is_not_proven_of_messages_and_fields_is_told_as_such(finding: Path) -> None:
    more = "the other 3 fields of these messages hardly matter (95 %: of such random values at most 3.1 % change the"
    assert any(line.strip() == f"{more} outcome)" for line in summary(finding).splitlines())
    MinimalRecord.load(finding).model_copy(update={"one_minimal": False}).save(finding)
    spent = {"fields": (), "unconfirmed": ("/map_updates:x",), "straight": 0, "complete": False}
    FieldsRecord.load(finding).model_copy(update=spent).save(finding)
    lines = [" ".join(line.replace("\N{NO-BREAK SPACE}", " ").split()) for line in summary(finding).splitlines()]
    assert "log 5 012 messages (38 modified) -> 1 kept, not proven" in lines
    assert "fields /map_updates:x (unconfirmed)" in lines
    assert "whether the other 4 fields of these messages matter is not known (not tested)" in lines
    page = write_report(finding).read_text()
    assert ">1 message kept<" in page
    assert ">of 5012, not proven<" in page


def test_where_a_rule_was_seen_to_be_wrong_is_told_with_it(finding: Path) -> None:
    wrong = ProportionRecord(value=0.69, low=0.59, high=0.77, count=77, total=112)
    RuleRecord.load(finding).model_copy(update={"in_campaign": wrong}).save(finding)
    assert " (right in only 77 of 112 trials of the campaign); the outside world" in summary(finding).splitlines()[0]


@pytest.mark.parametrize("done", range(1, 6))
def test_prefix_names_the_next_step(finding: Path, steps: dict[str, str], done: int) -> None:
    for name in list(steps)[done:]:
        (finding / name).unlink()
    lines = summary(finding).splitlines()
    assert lines[-1] == f"  next      riot {list(steps.values())[done]} {finding}"
    assert ("[permeable]" in lines[0]) == (done == 5)


def test_without_an_outside_the_rule_is_the_last_step(finding: Path, steps: dict[str, str]) -> None:
    for name in list(steps)[3:]:
        (finding / name).unlink()
    FindingRecord.load(finding).model_copy(update={"external": False}).save(finding)
    assert summary(finding).splitlines()[-1] == f"  next      riot rules {finding}"
    for record in rover():
        if isinstance(record, RuleRecord):
            record.save(finding)
    assert summary(finding).splitlines()[-1] == f"  again     riot reproduce {finding}"


def test_what_was_found_in_runs_of_the_whole_system_is_told_as_such(finding: Path) -> None:
    record = FindingRecord.load(finding)
    record = record.model_copy(
        update={
            "whole_system": True,
            "modified": 3,
            "injections": ({"topic": "/goal"}, {"topic": "/goal"}, {"topic": "/odom"}),
            "rate": ProportionRecord(value=0.75, low=0.2, high=1, count=3, total=4),
        }
    )
    record.save(finding)
    lines = summary(finding).splitlines()
    assert lines[0].endswith(
        "[whole system]  planner crashes in runs of the whole system with 3 changes to messages from outside, "
        "on /goal and /odom: 3 of 4 further runs failed again."
    )
    assert lines[-1] == f"  again     riot reproduce {finding}", "no further step can be run on it"
    assert [name for name in summary(finding).split() if name in ("rule", "fields", "region")] == []
    page = write_report(finding).read_text()
    assert "the system without its external components afresh, at most 20 times" in page
    assert '<text class="title"' in page
    assert "from outside" in page
    assert "Nothing shows yet that the system can produce them" not in page
    record.model_copy(update={"injections": (), "rate": None}).save(finding)
    assert summary(finding).splitlines()[0].endswith("in runs of the whole system with nothing changed.")


def test_nothing_permeable(finding: Path) -> None:
    (finding / "activation.json").unlink()
    path = finding / "permeability.json"
    record = json.loads(path.read_text())
    edges = [edge | {"permeable": False} for edge in record["edges"]]
    for given, words in (
        (edges, "none of the external fields that were tested reaches it."),
        ([], "whether any external field reaches it could not be determined."),
    ):
        path.write_text(json.dumps(record | {"edges": given}))
        first = summary(finding).splitlines()[0]
        assert "[unit only]" in first
        assert first.endswith(words)


def test_terminal_is_safe(finding: Path) -> None:
    path = finding / "finding.json"
    record = json.loads(path.read_text()) | {
        "signature": "a\x1b[2J\nb\u202ec",
        "component": "p\r\n",
        "monitor": "m\x07",
    }
    path.write_text(json.dumps(record))
    text = summary(finding)
    assert "a\\x1b[2J\\nb\\u202ec" in text
    assert not set(text) & {"\x1b", "\r", "\x07", "\u202e"}


def test_needs_a_finding(tmp_path: Path) -> None:
    with pytest.raises(ConfigError):
        summary(tmp_path)


def test_imports_nothing_heavy() -> None:
    code = "import sys, riot_bus.report.text; sys.exit(bool({'jinja2', 'numpy'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_words() -> None:
    assert [share(one) for one in (0, 1, 0.9999, 0.0001, 0.995, 0.5, 0.031, float("nan"))] == [
        "0 %", "100 %", "> 99.9 %", "< 0.1 %", "99.5 %", "50 %", "3.1 %", "nan %",
    ]  # fmt: skip
    assert [number(one) for one in (4194304, -91.25, 0.00512, float("inf"), 1e300)] == [
        "4194304", "-91.2", "0.00512", "inf", "1e+300",
    ]  # fmt: skip
    assert [seconds(one) for one in (0.44, 59, 71, 120, 3700, float("nan"))] == [
        "0.4 s", "59 s", "1 min 11 s", "2 min", "1 h 1 min", "?",
    ]  # fmt: skip
    assert [plural(1, "trial"), plural(2, "trial")] == ["1 trial", "2 trials"]
    assert [value(one) for one in (0.1, -1, True, 'a"b', 4194305)] == ["0.1", "-1", "True", '"a\\"b"', "4194305"]


def test_clean_is_bounded() -> None:
    assert len(clean("x" * 10_000, limit=100)) == 100
    assert clean("a\nb\tc", lines=True) == "a\nb\tc"
    assert clean("\ud800") == "\\ud800"


def test_findings_of_malformed_payloads_are_one_line(tmp_path: Path) -> None:
    folders = []
    for at in range(5):
        record = FindingRecord(
            id=f"crash-node-{at}",
            system="s",
            system_file="riot.toml",
            unit="node",
            component="node",
            monitor="crash",
            signature=f"crash in node: {at}",
            malformed=at > 0,
        )
        folders.append(tmp_path / record.id)
        folders[-1].mkdir()
        record.save(folders[-1])
    (line,) = unchecked(folders)
    assert line.startswith("payloads are not checked in 4 places: crash-node-1, crash-node-2, crash-node-3, ...; ")
    assert 'malformed = "each" in [unit.node]' in line
    assert unchecked(folders[:1]) == []
