"""Components that have more of the machine than they may are ended, by name; real processes."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from riot_bus.processes.launcher import Launcher
from riot_bus.processes.resource_limits import Guard, amount_text
from riot_bus.zenoh.session import wait_until

WAIT_S = 60.0
HOLD = "import time; print(flush=True); time.sleep(60)"
LIMITS = {"memory": 200 << 20, "files": 50, "processes": 10, "cpu": 1.0}
GREEDY = {
    "memory": f"kept = bytearray(b'1' * (300 << 20)); {HOLD}",
    "files": f"import os; kept = [os.open('/dev/null', 0) for _ in range(60)]; {HOLD}",
    "processes": f"import subprocess; kept = [subprocess.Popen(['sleep', '60']) for _ in range(12)]; {HOLD}",
    "cpu": "while True: pass",
}
ORPHANS = f"""
import os, subprocess
for _ in range(12):
    if os.fork() == 0:
        subprocess.Popen(["sleep", "60"], start_new_session=True)
        os._exit(0)
    os.wait()
{HOLD}
"""
SHARED = f"""
import os
kept = bytearray(b"1" * (100 << 20))
for _ in range(4):
    if os.fork() == 0:
        break
{HOLD}
"""


@pytest.fixture
def launcher() -> Iterator[Launcher]:
    with Launcher() as one:
        yield one


def ended(launcher: Launcher, code: str, folder: Path, **limits: float) -> tuple[int | None, str | None]:
    """Return the status of a component that has been ended, and what for."""
    process = launcher.start(
        "part", [sys.executable, "-S", "-c", code], env=dict(os.environ), cwd=folder, directory=folder, limits=limits
    )
    launcher.wait([process], timeout=WAIT_S)
    return process.status, process.excess and process.excess[0]


@pytest.mark.parametrize("what", GREEDY)
def test_each_limit_ends_what_is_beyond_it(launcher: Launcher, tmp_path: Path, what: str) -> None:
    assert ended(launcher, GREEDY[what], tmp_path, **LIMITS) == (-signal.SIGKILL, what)
    assert wait_until(lambda: str(tmp_path) not in [each.info["cwd"] for each in psutil.process_iter(["cwd"])], WAIT_S)


def test_processes_that_were_left_alone_count_too(launcher: Launcher, tmp_path: Path) -> None:
    assert ended(launcher, ORPHANS, tmp_path, **LIMITS) == (-signal.SIGKILL, "processes")


def test_an_end_of_its_own_is_none_by_a_limit(launcher: Launcher, tmp_path: Path) -> None:
    assert ended(launcher, "import sys; sys.exit(3)", tmp_path, **LIMITS) == (3, None)
    kill = "import os; os.kill(os.getpid(), 9)"
    assert ended(launcher, kill, tmp_path, **LIMITS) == (-signal.SIGKILL, None)


def test_what_forked_processes_share_counts_once_and_0_is_any_amount(launcher: Launcher, tmp_path: Path) -> None:
    process = launcher.start(
        "part", [sys.executable, "-S", "-c", SHARED], env=dict(os.environ), cwd=tmp_path, directory=tmp_path
    )
    assert wait_until(lambda: process.printed().count("\n") == 5, WAIT_S)
    assert sum(each.memory_info().rss for each in family(process.pid)) > LIMITS["memory"]
    assert Guard(process.pid, LIMITS).excess() is None
    what, amount = Guard(process.pid, LIMITS | {"memory": 50 << 20}).excess() or ("", 0)
    assert what == "memory"
    assert 100 << 20 < amount < 200 << 20
    assert Guard(process.pid, dict.fromkeys(LIMITS, 0)).excess() is None
    assert Guard(2**22 + 1, LIMITS).excess() is None


def family(pid: int) -> list[psutil.Process]:
    return [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]


def test_amounts_are_told_with_their_units() -> None:
    assert [amount_text("memory", 3 << 29), amount_text("cpu", 60.2), amount_text("files", 51)] == [
        "1,536 MiB",
        "60 s",
        "51",
    ]
