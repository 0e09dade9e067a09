"""What follows from the records of a finding; its sentences are read in test_text.py and test_page.py."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.findings.activation import ActivationRecord, RangeRecord, RegionRecord
from riot_bus.report.finding_view import FindingView, load
from tests.unit.report.conftest import GOAL_X, GOAL_Y


def changed(folder: Path, **changes: object) -> FindingView:
    """Return the finding with another activation."""
    ActivationRecord.load(folder).model_copy(update=changes).save(folder)
    return load(folder)


@pytest.mark.parametrize(
    ("failed", "controls", "severity"),
    [
        (10, (0, 0), "activated"),
        (4, (0, 10), "activated"),
        (2, (0, 40), "activated"),
        (0, (0, 10), "permeable"),
        (1, (1, 10), "permeable"),
        (1, (0, 10), "permeable"),
        (10, (9, 10), "permeable"),
    ],
)
def test_replays_have_to_fail_more_often_than_runs_with_nominal_inputs(
    finding: Path, failed: int, controls: tuple[int, int], severity: str
) -> None:
    view = changed(finding, replays_failed=failed, controls_failed=controls[0], controls=controls[1])
    assert view.severity == severity
    told = "".join(part.text for part in view.verdict())
    assert ("the outside world reaches it through" in told) == (severity == "activated")
    nominal = f", not significantly more often than with nominal inputs ({controls[0]} of {controls[1]})."
    assert told.endswith(nominal) == (severity != "activated" and failed > 0)


@pytest.mark.parametrize(
    ("found", "ranges", "told"),
    [
        ({GOAL_Y: -91.0}, {GOAL_X: ("low", "high"), GOAL_Y: ("low",)}, (GOAL_Y,)),
        ({GOAL_Y: -91.0}, {GOAL_X: (), GOAL_Y: ("low",)}, (GOAL_Y, GOAL_X)),
        ({"[end of part 1]": 2.0, "/a:x [part 1]": 1.0, "/a:x [part 2]": 3.0}, {}, ("/a:x",)),
        ({"/a:b[1] [amplitude]": 2.0, "[period]": 0.5}, {}, ("/a:b[1]",)),
        ({"/a:x [one message]": 2.0, "[place of the message]": 0.5, "/b:y [point 2]": 1}, {}, ("/a:x", "/b:y")),
    ],
)
def test_the_fields_that_were_found_come_first_and_what_limits_nothing_is_not_named(
    finding: Path, found: dict[str, float], ranges: dict[str, tuple[str, ...]], told: tuple[str, ...]
) -> None:
    axes = tuple(
        RangeRecord.model_validate({"field": name, "low": 0, "high": 1, "ends": ends}) for name, ends in ranges.items()
    )
    view = changed(finding, found=found, region=RegionRecord(ranges=axes) if axes else None)
    assert view.externals == told
