from __future__ import annotations

import os
from pathlib import Path

import pytest

from riot_bus.processes.placement import HOOK, StartedProcesses
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_bridges.ros_test.placement import Placement


def placement(folder: Path, nodes: str | None = None) -> Placement:
    return Placement(folder, segment="unit", nodes=nodes, variables={})


def test_the_hook_comes_first_and_what_was_there_stays(tmp_path: Path) -> None:
    found = placement(tmp_path).environment({"PYTHONPATH": "/opt/ros/lib"})
    assert found["PYTHONPATH"] == f"{HOOK}{os.pathsep}/opt/ros/lib"
    assert Path(found["RIOT_PLACEMENT"]).parent == tmp_path
    assert placement(tmp_path).environment({})["PYTHONPATH"] == str(HOOK)


def test_what_is_no_regular_expression(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--unit-nodes: 'a\\(' is not a regular expression"):
        placement(tmp_path, "a(")


def test_processes_are_counted_by_the_last_of_their_names(tmp_path: Path) -> None:
    placed = placement(tmp_path, "planner")
    assert placed.started() == StartedProcesses({}, {})
    with (tmp_path / "started.jsonl").open("a") as out:
        out.write('{"names": ["python3", "planner.py", "planner"], "segment": "unit"}\n' * 2)
        out.write('{"names": ["git"], "segment": ""}\n{"names": "git"}\n{"na\n7\n')
    assert placed.started() == StartedProcesses({"planner": 2}, {"git": 1})
