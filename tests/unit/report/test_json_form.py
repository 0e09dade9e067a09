from __future__ import annotations

import json
from pathlib import Path

from riot_bus.report.finding_view import load
from riot_bus.report.json_form import JsonReport


def test_the_document_has_all_records_by_step(finding: Path, steps: dict[str, str]) -> None:
    document = json.loads(JsonReport().render(load(finding)))
    assert list(document["steps"]) == list(steps.values())
    for name, step in steps.items():
        assert document["steps"][step] == json.loads((finding / name).read_text())
    assert (document["severity"], document["next"], document["unusable"]) == ("activated", None, {})
    assert document["folder"] == str(finding)


def test_missing_and_unusable_records_are_null(finding: Path) -> None:
    (finding / "activation.json").unlink()
    (finding / "rule.json").write_text("{")
    document = json.loads(JsonReport().render(load(finding)))
    assert (document["steps"]["rules"], document["steps"]["activate"], document["next"]) == (None, None, "rules")
    assert list(document["unusable"]) == ["rule.json"]
