from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from riot_bus_bridges.ros_test.packages import (
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
