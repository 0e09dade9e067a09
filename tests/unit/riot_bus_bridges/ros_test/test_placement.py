from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from riot_bus.processes.placement import HOOK, StartedProcesses
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_bridges.ros_test.segments import (
    Placement,
    is_colcon_test,
    leave_account,
    package_lines,
    riot_command,
    router_per_package,
)


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("colcon test", True),
        ("/usr/bin/colcon --log-base log test --packages-select nav", True),
        ("python3 -m colcon test", True),
        ("colcon test-result", False),
        ("colcon build", False),
        ("pytest test colcon", False),
        ("make test", False),
    ],
)
def test_colcon_is_known(command: str, expected: bool) -> None:
    assert is_colcon_test(command.split()) is expected


def test_options_are_handed_on_as_they_were_written(tmp_path: Path) -> None:
    found = router_per_package({}, ["--intercept", "/odom"], folder=tmp_path, accounts=tmp_path / "accounts")
    plan = json.loads(Path(found["RIOT_PLACEMENT"]).read_text())
    own = ["--package", "{package}", "--in", "{folder}", "--account", str(tmp_path / "accounts"), "--"]
    assert plan["wrap"] == [*riot_command(), "ros-test", "--intercept", "/odom", *own]
    assert plan["cwd"] == str(Path.cwd())


def test_riot_starts_whatever_python_path_there_is(tmp_path: Path) -> None:
    (tmp_path / "json.py").write_text("raise ImportError('of another Python')")
    environment = {"PYTHONPATH": str(tmp_path)}
    for cwd in ("/", tmp_path):  # nor what module the working folder has
        ran = subprocess.run([*riot_command(), "--version"], capture_output=True, text=True, env=environment, cwd=cwd)
        assert ran.stdout.startswith("riot_bus "), ran.stderr


def test_all_packages_are_told_and_what_has_shown_nothing_loudly(tmp_path: Path) -> None:
    leave_account(tmp_path, "nav", ["5 messages", "NOTHING WAS INJECTED"], vacuous=True)
    leave_account(tmp_path, "../map\x1b", ["7 messages"], vacuous=False)
    assert package_lines(tmp_path) == [
        "../map\\x1b: 7 messages",
        "nav: 5 messages",
        "nav: NOTHING WAS INJECTED",
        "tests of 2 packages, each through a router of its own; NOTHING SHOWN by nav",
    ]


def test_no_package_at_all(tmp_path: Path) -> None:
    (line,) = package_lines(tmp_path)
    assert line.startswith("NO TESTS OF A PACKAGE WENT THROUGH A ROUTER")


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
