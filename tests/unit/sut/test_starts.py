from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from riot_bus.sut.starts import Start, start_of
from riot_bus.sut.system import Component, Container, RemoteHost

ENDPOINT = "tcp/127.0.0.1:41234"


def start(component: Component, folder: Path) -> Start:
    argv = list(component.command)
    return start_of(
        component,
        "riot-12ab-planner",
        argv=argv,
        env={"A": "1"},
        endpoint=ENDPOINT,
        there=ENDPOINT,
        folder=folder,
        cwd=folder,
    )


def test_a_command_is_executed_as_it_is(tmp_path: Path) -> None:
    component = Component(command=("plan", "-v"), teardown=("tidy",))
    assert start(component, tmp_path) == Start(["plan", "-v"], ("tidy",))


def test_a_container_is_removed_before_anything_else_is_torn_down(tmp_path: Path) -> None:
    told = tmp_path / "told"
    tool = tmp_path / "engine"
    tool.write_text(f'#!/bin/sh\necho "$@" >> {told}\n')
    tool.chmod(0o755)
    teardown = ("sh", "-c", f"echo 'at last' >> {told}")
    made = start(Component(container=Container(image="box", engine=str(tool)), teardown=teardown), tmp_path)
    assert (made.engine, made.relayed, made.held, made.lost) == (str(tool), True, False, 125)
    assert made.container == "riot-12ab-planner"
    assert "--env=A=1" in made.argv
    subprocess.run(made.teardown, check=True)
    assert told.read_text() == f"kill {made.container}\nrm -f {made.container}\nat last\n"


def test_another_machine_is_told_by_a_standard_input_that_stays_open(tmp_path: Path) -> None:
    made = start(Component(command=("plan",), ssh=RemoteHost(host="robot"), cwd="work"), tmp_path)
    assert (made.argv[0], made.held, made.relayed, made.lost) == ("ssh", True, True, 255)
    assert "cd work" in made.argv[-1]
    assert "env A=1 plan" in made.argv[-1]


def test_what_runs_already_is_found_by_its_port(tmp_path: Path) -> None:
    made = start(Component(attach="tcp/127.0.0.1:7447"), tmp_path)
    assert made.argv[:6] == [sys.executable, "-E", "-P", "-m", "riot_bus.sut.attached", "7447"]
    assert made.lost == 1
