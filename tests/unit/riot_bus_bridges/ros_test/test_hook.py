"""The hook of `riot ros-test`, in processes that start others in the ways that test suites do."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from riot_bus.processes.placement import HOOK, StartedProcesses
from riot_bus.processes.placement_hook import sitecustomize
from riot_bus_bridges.ros_test import hook
from riot_bus_bridges.ros_test import segments as placements
from riot_bus_bridges.ros_test.segments import Placement

SAYS = "import os; print(os.environ.get('WHERE'), os.environ.get('OWN'))"


def placement(folder: Path, nodes: str | None = "part") -> Placement:
    return Placement(folder, segment="unit", nodes=nodes, variables={"WHERE": "unit"})


def run(folder: Path, code: str, placed: Placement, **more: str) -> list[str]:
    """Run code in a process with the hook; return the lines that it prints."""
    given = {"PATH": os.environ["PATH"], "WHERE": "system", **more}
    environment = {**given, **placed.environment(given)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


STARTS = {
    "subprocess": "import subprocess as s, sys; s.run([sys.executable, '{script}'])",
    "an environment of its own": (
        "import subprocess as s, sys; s.run([sys.executable, '{script}'], env={{'OWN': 'yes'}})"
    ),
    "arguments by position": (
        "import subprocess as s, sys; "
        "s.Popen([sys.executable, '{script}'], -1, None, None, None, None, None, True, False, None, None).wait()"
    ),
    "an iterator": "import subprocess as s, sys; s.Popen(iter([sys.executable, '{script}'])).wait()",
    "a shell": "import subprocess as s, sys; s.run(f'{{sys.executable}} {script}', shell=True)",
    "asyncio, as launch does": (
        "import asyncio, sys\nasync def main():\n"
        "    process = await asyncio.create_subprocess_exec(sys.executable, '{script}')\n    await process.wait()\n"
        "asyncio.run(main())"
    ),
}


@pytest.mark.parametrize("way", STARTS)
def test_processes_are_put_into_the_segment_by_name(way: str, tmp_path: Path) -> None:
    for name in ("part.py", "apart.py"):
        (tmp_path / name).write_text(SAYS)
    placed = placement(tmp_path)
    own = "yes" if "own" in way else "None"
    assert run(tmp_path, STARTS[way].format(script="part.py"), placed) == [f"unit {own}"]
    where = "None" if "own" in way else "system"
    assert run(tmp_path, STARTS[way].format(script="apart.py"), placed) == [f"{where} {own}"]
    assert placed.started() == StartedProcesses({"part": 1}, {"apart": 1})


def test_children_stay_where_their_parent_is(tmp_path: Path) -> None:
    (tmp_path / "part.py").write_text(STARTS["subprocess"].format(script="child.py"))
    (tmp_path / "child.py").write_text(SAYS)
    assert run(tmp_path, STARTS["subprocess"].format(script="part.py"), placement(tmp_path)) == ["unit None"]


def test_what_cannot_be_started_is_as_without_the_hook(tmp_path: Path) -> None:
    code = """
import subprocess
for wrong in ([], ["./part"], [1], None):
    try:
        subprocess.run(wrong)
    except Exception as error:
        print(type(error).__name__)
try:
    subprocess.Popen()
except TypeError as error:
    print(error)
"""
    given = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert run(tmp_path, code, placement(tmp_path)) == given.stdout.splitlines()


def test_another_sitecustomize_is_imported_as_well_and_once(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "sitecustomize.py").write_text(
        "import importlib.machinery, importlib.util, sys\nprint('theirs')\n"
        "others = [each for each in sys.path if each != " + repr(str(theirs)) + "]\n"
        "found = importlib.machinery.PathFinder.find_spec('sitecustomize', others)\n"
        "found.loader.exec_module(importlib.util.module_from_spec(found))\n"
    )
    lines = run(tmp_path, "print('program')", placement(tmp_path), PYTHONPATH=str(theirs))
    assert lines == ["theirs", "program"]


def test_what_is_told_is_bounded(tmp_path: Path) -> None:
    placed = placement(tmp_path)
    (tmp_path / "started.jsonl").write_bytes(b"x" * (sitecustomize._LARGEST - 10))
    run(tmp_path, "import subprocess\nfor _ in range(9): subprocess.run(['true'])", placed)
    assert (tmp_path / "started.jsonl").stat().st_size < sitecustomize._LARGEST + 100


ROUTER = '["tcp/127.0.0.1:7448"]'
LISTEN = '["tcp/127.0.0.1:0"]'


@pytest.mark.parametrize(
    ("own", "mode", "connect"),
    [
        ({}, '"client"', ROUTER),
        ({"mode": '"peer"', "timestamping/enabled": "true"}, '"client"', ROUTER),
        ({"mode": '"router"'}, '"router"', "[]"),
        ({"mode": '"peer"', "listen/endpoints": LISTEN}, '"peer"', "[]"),
        ({"connect/endpoints": LISTEN}, "null", LISTEN),
        ({"scouting/multicast/enabled": "false"}, "null", "[]"),
    ],
)
def test_a_session_that_would_look_for_others_connects_to_its_segment(
    own: dict[str, str], mode: str, connect: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "unit.json5").write_text(
        f'{{mode: "client", connect: {{endpoints: {ROUTER}}}, scouting: {{multicast: {{enabled: false}}}}}}'
    )
    monkeypatch.setenv("ZENOH_CONFIG", str(tmp_path / "unit.json5"))
    config = zenoh.Config()
    for key, value in own.items():
        config.insert_json5(key, value)
    before, module = str(config), SimpleNamespace(open=lambda found: found, Config=zenoh.Config)
    hook.joined(module)
    found = module.open(config)
    assert (found.get_json("mode"), found.get_json("connect/endpoints")) == (mode, connect)
    assert found.get_json("timestamping/enabled") == own.get("timestamping/enabled", "null")
    assert str(config) == before


def test_without_a_file_of_riot_sessions_are_opened_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ZENOH_CONFIG", raising=False)
    module = SimpleNamespace(open=lambda found: found, Config=zenoh.Config)
    hook.joined(module)
    config = zenoh.Config()
    assert module.open(config) is config


WRAP = {"wrap": ["riot", "ros-test", "--package", "{package}", "--in", "{folder}", "--"], "cwd": "/home"}


def wrapped(monkeypatch: pytest.MonkeyPatch, argv0: str, **popen: Any) -> dict[str, Any]:
    monkeypatch.setattr(sys, "argv", [argv0, "test"])
    found = {"cwd": "/ws/build/nav", **popen}
    hook.wrapped(sitecustomize, WRAP, found)
    return found


def test_the_tests_of_each_package_are_wrapped(monkeypatch: pytest.MonkeyPatch) -> None:
    ctest = ["/usr/bin/ctest", "-C", "Release", "-D", "ExperimentalTest"]
    own = ["riot", "ros-test", "--package", "nav", "--in", "/ws/build/nav", "--"]
    assert wrapped(monkeypatch, "/usr/bin/colcon", args=ctest) == {"args": [*own, *ctest], "cwd": "/home"}
    python = ["/usr/bin/python3", "-m", "pytest"]
    env = {"PYTEST_ADDOPTS": "--tb=short --junit-prefix=nav_py"}
    own = ["riot", "ros-test", "--package", "nav_py", "--in", "/ws/src/py", "--"]
    found = wrapped(monkeypatch, "/usr/bin/colcon", args=python, env=env, cwd="/ws/src/py")
    assert found == {"args": [*own, *python], "cwd": "/home", "env": env}


@pytest.mark.parametrize(
    "args",
    [["/usr/bin/ctest", "--show-only"], ["cmake", "--build", "."], ["/usr/bin/python3", "-c", "pytest"]],
)
def test_what_else_colcon_starts_is_not(args: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert wrapped(monkeypatch, "/usr/bin/colcon", args=args)["args"] == args


def test_other_programs_wrap_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert wrapped(monkeypatch, "/usr/bin/make", args=["ctest"])["args"] == ["ctest"]


def test_a_plan_says_whose_tests_to_wrap(tmp_path: Path) -> None:
    (tmp_path / "colcon").write_text("import subprocess\nsubprocess.run(['ctest'], cwd='/')\n")
    (tmp_path / "plan.json").write_text(
        json.dumps({"wrap": ["echo", "{package}", "{folder}"], "cwd": str(tmp_path), "hook": str(placements.HOOK)})
    )
    environment = {"PATH": os.environ["PATH"], "PYTHONPATH": str(HOOK), "RIOT_PLACEMENT": str(tmp_path / "plan.json")}
    done = subprocess.run(
        [sys.executable, str(tmp_path / "colcon")], capture_output=True, text=True, env=environment, check=True
    )
    assert done.stdout == " / ctest\n"
