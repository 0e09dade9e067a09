from __future__ import annotations

import json
from pathlib import Path

from riot_bus.chain.ci_result import CiResult, UnitResult
from riot_bus.report.campaign_view import CampaignView
from riot_bus.testing.reports import HOSTILE_TEXT, campaign_with_baseline


def test_exit_codes() -> None:
    def unit(**more: object) -> UnitResult:
        return UnitResult("u", CampaignView(Path("o"), None, (), known={}), **more)  # type: ignore[arg-type]

    assert CiResult((unit(),)).exit_code(strict=True) == 0
    assert CiResult((unit(), unit(untested="no port"))).exit_code(strict=True) == 4
    assert CiResult((unit(), unit(undecided=("x",)))).exit_code(strict=True) == 5
    assert CiResult((unit(), unit(untested="x", undecided=("x",)))).exit_code(strict=False) == 0


def test_all_is_said_for_people_in_lines_that_move_no_cursor(tmp_path: Path) -> None:
    view = campaign_with_baseline("several", tmp_path, note=HOSTILE_TEXT)
    lines = CiResult((UnitResult("planner", view),)).lines()
    assert lines[0] == f"planner: {view.verdict}"
    assert any(line.startswith("  known: IndexError in costmap.py:update") for line in lines)
    assert lines[-1] == "no new finding"
    assert all(line.isprintable() for line in lines)


def test_programs_get_each_finding_with_its_standing(tmp_path: Path) -> None:
    view = campaign_with_baseline("several", tmp_path)
    told = json.loads(json.dumps(UnitResult("planner", view, ("x",)).to_json()))
    assert [each["standing"] for each in told["findings"]] == [view.standing(one) for one in view.current]
    assert told["doubts"][0] == "x"
    assert told["remarks"] == ["ticket 12"]
