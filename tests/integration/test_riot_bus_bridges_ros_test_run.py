"""How `riot ros-test` ends, and packages that have a router each."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from riot_bus.zenoh.session import wait_until
from tests.integration.existing_suite import ros_test, write_suite
from tests.integration.router_process import ENVIRONMENT, RIOT, riot

pytestmark = pytest.mark.integration

WAIT_S = 60.0
FORKS = """
import os, signal, subprocess, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
children = [subprocess.Popen(["sleep", "611"], start_new_session=True) for _ in range(2)]
print(os.getpid(), *[child.pid for child in children], flush=True)
if sys.argv[1] == "asks":
    signal.signal(signal.SIGINT, lambda *_: sys.exit(9))
time.sleep(600)
"""


class Running:
    """A `riot ros-test` under way, and all the processes of its command."""

    def __init__(self, folder: Path, manner: str) -> None:
        command = [*RIOT, "ros-test", "--", sys.executable, "-c", FORKS, manner]
        self.riot = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder, env=ENVIRONMENT
        )
        assert self.riot.stdout is not None
        pids = [int(word) for word in self.riot.stdout.readline().split()]
        assert len(pids) == 3
        self.processes = [psutil.Process(pid) for pid in pids]

    def gone(self) -> bool:
        return wait_until(lambda: not any(map(_runs, self.processes)), WAIT_S)

    def end(self) -> int:
        self.riot.communicate(timeout=WAIT_S)
        return self.riot.returncode


def _runs(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_ctrl_c_is_told_to_the_command_which_ends_as_it_likes(tmp_path: Path) -> None:
    running = Running(tmp_path, "asks")
    running.riot.send_signal(signal.SIGINT)
    assert running.gone()
    assert running.end() == 9


def test_a_second_one_ends_what_does_not_listen(tmp_path: Path) -> None:
    running = Running(tmp_path, "ignores")
    for _ in range(2):
        running.riot.send_signal(signal.SIGTERM)
        wait_until(lambda: running.riot.poll() is not None, 1.0)
    assert running.gone()
    assert running.end() == 130


def test_nothing_outlives_a_riot_that_is_killed(tmp_path: Path) -> None:
    running = Running(tmp_path, "ignores")
    scratch = Path(running.processes[0].environ()["RIOT_PLACEMENT"]).parent
    assert scratch.exists()
    running.riot.kill()
    assert running.gone()
    assert wait_until(lambda: not scratch.exists(), WAIT_S)
    assert running.end() == -signal.SIGKILL


COLCON = """
import subprocess, sys
for package in ("nav", "map"):
    subprocess.run([sys.executable, "-m", "pytest"], cwd=package, check=True)
"""


def test_tests_of_each_package_have_a_router_of_their_own(tmp_path: Path) -> None:
    for package in ("nav", "map"):
        (tmp_path / package).mkdir()
        write_suite(tmp_path / package)
    (tmp_path / "colcon").write_text(COLCON)
    command = [sys.executable, "colcon", "test"]
    options = ("--unit-nodes=listener", "--interceptor=./same.py", "--record=logs")
    (tmp_path / "same.py").write_text(
        "class Same:\n    topics = ['pose']\n    def message(self, event):\n        pass\n"
    )
    code, out, said = ros_test(tmp_path, *options, command=command, PYTEST_ADDOPTS="-q -p no:cacheprovider")
    assert (code, out.count("1 passed")) == (0, 2)
    assert [line.partition(":")[0] for line in said[-5:-1]] == ["map", "map", "nav", "nav"]
    assert said[-1] == "tests of 2 packages, each through a router of its own"
    assert sorted(path.name for path in (tmp_path / "logs").iterdir()) == ["map.mcap", "nav.mcap"]


def test_several_packages_in_one_log(tmp_path: Path) -> None:
    code, _, err = riot("ros-test", "--record=run.mcap", "colcon", "test", cwd=tmp_path)
    assert (code, "one log for the tests of several packages" in err) == (2, True)


def test_colcon_that_tests_nothing(tmp_path: Path) -> None:
    (tmp_path / "colcon").write_text("")
    code, _, said = ros_test(tmp_path, command=[sys.executable, "colcon", "test"])
    assert (code, said[0].partition(":")[0]) == (0, "NO TESTS OF A PACKAGE WENT THROUGH A ROUTER")
