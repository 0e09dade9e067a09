from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from riot_bus.draft.model import CommandDraft
from riot_bus.draft.process_facts import bridged_domain, facts_of, nodes_of_domain
from riot_bus.graph.survey import Started
from riot_bus.zenoh.session import wait_until

DOMAIN = 200 + os.getpid() % 32
"""One that no bridge and no other test uses: riot's own are 1 to 100, and DDS has none above 232."""
LAUNCH = """
import os, subprocess, sys

commands = [
    [sys.executable, "nodes.py", "--ros-args", "-r", "__node:=planner", "-r", "__ns:=/robot1"],
    [sys.executable, "nodes.py", "--ros-args", "-r", "__node:=lidar"],
    [sys.executable, "-u", "motor.py"],
]
nodes = [subprocess.Popen(command) for command in commands]
os.write(1, b"started\\n")
for each in nodes:
    each.wait()
"""
NODE = "import os, sys\nos.write(1, b'up\\n')  # at once, since all write to one pipe\nsys.stdin.read()\n"


@contextmanager
def process(folder: Path, *command: str, **env: str) -> Iterator[Started]:
    with subprocess.Popen(command, cwd=folder, env={**os.environ, **env}, stdin=subprocess.PIPE) as running:
        try:
            assert wait_until(lambda: bool(psutil.Process(running.pid).cmdline()), 30)
            yield Started(running.pid, tuple(psutil.Process(running.pid).cmdline()), str(folder))
        finally:
            running.kill()


def test_environment_program_and_files_that_say_where_to_connect(tmp_path: Path) -> None:
    (tmp_path / "z.json5").write_text('{ connect: ["tcp/h:7447"] }')
    (tmp_path / "other.json").write_text('["tcp/h:7448"]')
    (tmp_path / "bytes").write_bytes(b"\xff tcp/h:7447")
    (tmp_path / "env.yaml").write_text("tcp/h:7447")
    words = ("-c", "input()", "--conf=z.json5", "other.json", "bytes", "missing", "")
    with process(tmp_path, sys.executable, *words, ZENOH_CONFIG="env.yaml", MARK="5") as started:
        found = facts_of(started, {7447})
    assert found.environment["MARK"] == "5"
    assert found.program == sys.executable
    assert {Path(path).name for path in found.files} == {"z.json5", "env.yaml"}


def test_a_python_is_that_of_riot_only_in_its_folder(tmp_path: Path) -> None:
    link = tmp_path / "python3"
    link.symlink_to(sys.executable)
    with process(tmp_path, str(link), "-c", "input()") as started:
        assert facts_of(started, ()).program == str(link)
    beside = Path(sys.executable).with_name("python3")
    if beside.exists():
        with process(tmp_path, str(beside), "-c", "input()") as started:
            assert facts_of(started, ()).program == sys.executable


def test_what_is_gone_is_as_it_was_started() -> None:
    found = facts_of(Started(2**22 + 1, ("no-such-program", "x"), "/"), {1})
    assert (found.program, found.environment, found.files) == ("", {}, {})
    assert found.command == ("no-such-program", "x")


@pytest.fixture
def launched(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A Python program that has started three nodes, which end with it."""
    for name, text in (("launch.py", LAUNCH), ("nodes.py", NODE), ("motor.py", NODE)):
        (tmp_path / name).write_text(text)
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)}
    command = [sys.executable, "launch.py"]
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert sorted(process.stdout.readline() for _ in range(4)) == ["started\n", "up\n", "up\n", "up\n"]
        yield process


def test_nodes_of_a_launch_file(launched: subprocess.Popen[str], tmp_path: Path) -> None:
    found = nodes_of_domain(DOMAIN)
    launch = (launched.pid, (sys.executable, "launch.py"), str(tmp_path))
    chosen = {
        name: start.only
        for name, start in found.items()
        if start.only and (start.pid, start.command, start.cwd) == launch
    }
    assert chosen == {"/robot1/planner": "/robot1/planner", "/lidar": "lidar", "/motor": "motor"}
    assert nodes_of_domain(DOMAIN + 1) == {}


def test_a_node_that_was_started_by_itself(tmp_path: Path) -> None:
    (tmp_path / "motor.py").write_text(NODE)
    command = [sys.executable, "motor.py", "--ros-args", "-r", "__node:=arm"]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)}
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        (start,) = nodes_of_domain(DOMAIN).values()
    assert start == CommandDraft(tuple(command), str(tmp_path), pid=process.pid)


@pytest.mark.parametrize(
    ("command", "domain"),
    [
        (("riot", "bridge", "ros2", "--domain", "7"), 7),
        (("riot", "bridge", "ros2", "-d", "8", "--segment", "unit"), 8),
        (("python", "-m", "riot_bus", "bridge", "ros2", "--domain=9"), 9),
        (("riot", "bridge", "ros2", "--domain", "x"), None),
        (("riot", "bridge", "mavlink"), None),
        (("riot", "router"), None),
    ],
)
def test_the_domain_of_a_bridge(command: tuple[str, ...], domain: int | None) -> None:
    assert bridged_domain(Started(1, command, "/")) == domain


def test_the_domain_of_a_bridge_that_was_told_by_its_environment() -> None:
    command = ("riot", "bridge", "ros2")
    with subprocess.Popen(
        ["cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**os.environ, "ROS_DOMAIN_ID": "11"}
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(b"up\n")
        process.stdin.flush()
        assert process.stdout.readline() == b"up\n"  # before its first instruction, it has no environment yet
        assert bridged_domain(Started(process.pid, command, "/")) == 11
        process.stdin.close()
