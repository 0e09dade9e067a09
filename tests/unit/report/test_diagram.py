from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.findings.records import FindingRecord, MinimalRecord
from riot_bus.report.diagram import DiagramBox, links
from riot_bus.report.finding_view import load


def boxes(finding: Path) -> list[DiagramBox]:
    return links(load(finding))


def test_a_whole_chain(finding: Path) -> None:
    found = boxes(finding)
    assert [box.state for box in found] == ["done"] * 7
    assert [box.lines for box in found] == [
        ("of rover", "into planner"),
        ("5\N{NO-BREAK SPACE}012 messages", "38 modified"),
        ("1 message needed", "of 5012"),
        ("2 of 5", "x, y"),
        ("x * y < 0 or x * y…", "240 samples"),
        ("4 of 5 reach it", "pose.position.y, p…"),
        ("10 of 10 replays", "200 system runs"),
    ]
    assert [box.effort for box in found][:2] == ["", "212 trials, 5 min 41 s"]


def test_the_first_open_step_is_next_and_names_its_command(finding: Path) -> None:
    for name in ("rule.json", "permeability.json", "activation.json"):
        (finding / name).unlink()
    found = boxes(finding)
    assert [box.state for box in found] == ["done"] * 4 + ["next", "open", "open"]
    assert (found[4].lines[0], found[4].effort) == ("riot rules", "")


def test_what_is_not_proven_is_not_called_needed(finding: Path) -> None:
    record = MinimalRecord.load(finding)
    record.model_copy(update={"one_minimal": False}).save(finding)
    assert boxes(finding)[2].lines == ("1 message kept", "of 5012, not proven")


@pytest.mark.parametrize("name", ["\x1b[2J", "x" * 1000])
def test_names_of_others_cannot_leave_their_box(finding: Path, name: str) -> None:
    FindingRecord.load(finding).model_copy(update={"unit": name, "system": name}).save(finding)
    for box in boxes(finding):
        assert all(len(line) <= 19 and line.isprintable() for line in (line.replace("\xa0", "") for line in box.lines))
