"""What a process is told about which of its child processes it starts, and what the hook has reported."""

from __future__ import annotations

import json
import os
from pathlib import Path

from riot_bus.processes.placement import HOOK, STARTED, StartedProcesses, only_some, started_in


def test_the_hook_comes_first_and_what_was_there_stays(tmp_path: Path) -> None:
    plan = tmp_path / "part.only"
    found = only_some({"PYTHONPATH": "/opt/ros/lib"}, "plan.*", plan=plan)
    assert found == {"PYTHONPATH": f"{HOOK}{os.pathsep}/opt/ros/lib", "RIOT_PLACEMENT": str(plan)}
    assert json.loads(plan.read_text()) == {"only": "plan.*", "told": str(plan.with_suffix(STARTED))}


def test_processes_are_counted_by_the_last_of_their_names(tmp_path: Path) -> None:
    only_some({}, "planner", plan=tmp_path / "part")
    told = tmp_path / f"part{STARTED}"
    assert started_in(told) == StartedProcesses({}, {})
    with told.open("a") as out:
        out.write('{"names": ["python3", "planner.py", "planner"], "segment": "only"}\n' * 2)
        out.write('{"names": ["git"], "segment": ""}\n{"names": "git"}\n{"na\n7\n')
    assert started_in(told) == StartedProcesses({"planner": 2}, {"git": 1})
