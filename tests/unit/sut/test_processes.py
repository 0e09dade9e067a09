"""Launcher, supervisor and settling, with real processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from riot_bus.sut.activity import Threads, families
from riot_bus.sut.launcher import ComponentProcess, Launcher
from riot_bus.sut.settling import wait_settled
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import wait_until

Start = Callable[[str], ComponentProcess]
WAIT_S = 20.0


@pytest.fixture
def launcher() -> Iterator[Launcher]:
    with Launcher() as one:
        yield one


@pytest.fixture
def start(launcher: Launcher, tmp_path: Path) -> Start:
    def run(code: str) -> ComponentProcess:
        return launcher.start(
            "part", [sys.executable, "-S", "-c", code], env=dict(os.environ), cwd=tmp_path, directory=tmp_path
        )

    return run


def test_exit_status_and_output(launcher: Launcher, start: Start) -> None:
    process = start("import sys; print('words', file=sys.stderr); sys.exit(3)")
    assert launcher.wait([process], timeout=20)
    assert (process.status, process.errors()) == (3, "words\n")
    assert not launcher.alive(process)


def test_death_by_signal(launcher: Launcher, start: Start) -> None:
    process = start("import time; time.sleep(60)")
    assert launcher.alive(process)
    launcher.interrupt(process, signal.SIGTERM)
    assert launcher.wait([process], timeout=20)
    assert process.status == -signal.SIGTERM


def test_command_that_does_not_exist(launcher: Launcher, tmp_path: Path) -> None:
    with pytest.raises(EnvironmentFaultError, match="no-such-program"):
        launcher.start("part", ["no-such-program"], env={}, cwd=tmp_path, directory=tmp_path)


def test_output_may_be_ours_and_a_folder_goes_with_the_processes(tmp_path: Path) -> None:
    (scratch := tmp_path / "scratch").mkdir()
    code = f"""
from pathlib import Path
from riot_bus.sut.launcher import Launcher
with Launcher(quiet=False, scratch=Path({str(scratch)!r})) as launcher:
    command = ["sh", "-c", "echo out; echo err >&2; cat"]
    process = launcher.start("part", command, env={{}}, cwd=Path("/"), directory=None)
    assert launcher.wait([process], timeout={WAIT_S})
    print(process.status, process.printed(), process.errors())
"""
    done = subprocess.run([sys.executable, "-c", code], input="not read", capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("out\n0  \n", "err\n")
    assert not scratch.exists()


def test_kill_all_takes_grandchildren_along(launcher: Launcher, start: Start, tmp_path: Path) -> None:
    code = "import subprocess,time; subprocess.Popen(['sleep','97.5'], start_new_session=True); time.sleep(60)"
    process = start(code)
    assert wait_until(lambda: bool(psutil.Process(process.pid).children()), WAIT_S)
    (grandchild,) = psutil.Process(process.pid).children()
    launcher.kill_all()
    assert not psutil.pid_exists(process.pid)
    assert not psutil.pid_exists(grandchild.pid)


def test_nothing_outlives_a_killed_owner(tmp_path: Path) -> None:
    code = (
        "import os,sys,time,pathlib; from riot_bus.sut.launcher import Launcher\n"
        "d = pathlib.Path(sys.argv[1])\n"
        "launcher = Launcher()\n"
        "p = launcher.start('part', ['sleep', '96.5'], env=dict(os.environ), cwd=d, directory=d)\n"
        "print(p.pid, flush=True); time.sleep(60)"
    )
    root = str(Path(__file__).resolve().parents[3])
    owner = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": root},
    )
    assert owner.stdout is not None
    pid = int(owner.stdout.readline())
    assert psutil.pid_exists(pid)
    owner.kill()
    owner.wait()
    owner.stdout.close()
    assert wait_until(lambda: not psutil.pid_exists(pid), WAIT_S)


def test_settling(launcher: Launcher, start: Start) -> None:
    busy = start("while True: pass")
    assert not wait_settled(Threads([busy.pid]), window=0.05, timeout=0.5)
    idle = start("import time; time.sleep(60)")
    assert wait_settled(Threads([idle.pid]), window=0.05, timeout=20)
    assert Threads([idle.pid]).activity().switches > 0
    assert not Threads([idle.pid]).busy()
    assert wait_settled(Threads([busy.pid]), window=0.05, timeout=20, alive=lambda: False)


def test_what_a_component_has_started_counts_too(start: Start) -> None:
    busy = "import sys; print(flush=True)\nwhile True: pass"
    code = f"import subprocess,sys,time; subprocess.Popen([sys.executable,'-S','-c',{busy!r}]); time.sleep(60)"
    process = start(code)
    assert wait_until(lambda: len(families([process.pid])) == 2 and process.stdout.stat().st_size > 0, WAIT_S)
    assert wait_settled(Threads([process.pid]), window=0.05, timeout=20)
    assert not wait_settled(Threads(families([process.pid])), window=0.05, timeout=0.5)
    assert families([2**22 + 1]) == [2**22 + 1]
