"""Launcher, supervisor and settling, with real processes."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from riot_bus.processes.activity import Threads, families
from riot_bus.processes.launcher import ComponentProcess, Launcher
from riot_bus.trial.settling import wait_settled
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
from riot_bus.processes.launcher import Launcher
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
        "import os,sys,time,pathlib; from riot_bus.processes.launcher import Launcher\n"
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


def test_what_is_torn_down_when_a_component_has_ended(launcher: Launcher, tmp_path: Path) -> None:
    def begin(name: str, *command: str, teardown: str) -> ComponentProcess:
        words = ["sh", "-c", teardown]
        env = dict(os.environ)
        return launcher.start(name, command, env=env, cwd=tmp_path, directory=tmp_path, teardown=words)

    ends = begin("ends", "true", teardown="sleep 0.2; echo torn; touch ends")
    assert launcher.wait([ends], timeout=WAIT_S)
    assert (ends.status, ends.torn_down, (tmp_path / "ends").exists()) == (0, False, False)
    assert launcher.wait([ends], timeout=WAIT_S, torn_down=True)
    assert (tmp_path / "ends").exists()
    assert (tmp_path / "ends.teardown").read_text() == "torn\n"
    begin("stays", "sleep", "94.5", teardown="sleep 0.2; touch stays")
    launcher.kill_all()
    assert (tmp_path / "stays").exists()


def test_what_only_undoes_is_run_after_no_good_end(launcher: Launcher, tmp_path: Path) -> None:
    for name, *command in (("good", "true"), ("bad", "false"), ("long", "sleep", "93.5")):
        words = {"env": dict(os.environ), "cwd": tmp_path, "directory": tmp_path}
        launcher.start(name, command, **words, teardown=["touch", f"undone-{name}"], undoes=True)
    launcher.kill_all()
    assert sorted(path.name for path in tmp_path.glob("undone-*")) == ["undone-bad", "undone-long"]


def test_a_teardown_that_fails_is_told(launcher: Launcher, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name, words in (("fails", ["sh", "-c", "exit 4"]), ("missing", ["no-such-program"])):
        env, here = dict(os.environ), tmp_path
        process = launcher.start(name, ["true"], env=env, cwd=here, directory=here, teardown=words)
        assert launcher.wait([process], timeout=WAIT_S, torn_down=True)
        assert process.status == 0
    assert next(record.args for record in caplog.records) == ("fails", "status 4")
    assert "no-such-program" in caplog.text


def test_ends_that_come_with_the_answer_to_the_start_are_not_lost(
    launcher: Launcher, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    pump, link = launcher._pump, launcher._link

    def late(timeout: float) -> None:
        assert wait_until(lambda: b"torn down" in link.recv(1 << 16, socket.MSG_PEEK), WAIT_S)
        pump(timeout)

    monkeypatch.setattr(launcher, "_pump", late)
    around = {"env": dict(os.environ), "cwd": tmp_path, "directory": tmp_path}
    process = launcher.start("ends", ["true"], **around, teardown=["false"])
    assert (process.status, process.torn_down) == (0, True)
    assert caplog.records[0].args == ("ends", "status 1")


def test_what_is_torn_down_when_riot_is_killed(tmp_path: Path) -> None:
    code = (
        "import os,sys,time,pathlib; from riot_bus.processes.launcher import Launcher\n"
        "d = pathlib.Path(sys.argv[1])\n"
        "launcher = Launcher()\n"
        "words = ['sh', '-c', 'cat; touch held']\n"
        "teardown = ['sh', '-c', 'sleep 0.3; touch torn']\n"
        "p = launcher.start('part', words, env=dict(os.environ), cwd=d, directory=d, script='', teardown=teardown)\n"
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
    assert wait_until(
        lambda: bool(psutil.Process(pid).children()), WAIT_S
    )  # it reads its standard input, which is open
    owner.kill()
    owner.wait()
    owner.stdout.close()
    assert wait_until((tmp_path / "torn").exists, WAIT_S)
    assert not psutil.pid_exists(pid)


def test_a_script_arrives_whole_though_it_is_longer_than_a_pipe(launcher: Launcher, tmp_path: Path) -> None:
    around = {"env": dict(os.environ), "cwd": tmp_path, "directory": tmp_path}
    process = launcher.start("part", ["sh"], **around, script=f"x={'y' * 300_000}; echo ${{#x}}; exit 3\n")
    assert launcher.wait([process], timeout=WAIT_S)
    assert (process.status, process.printed()) == (3, "300000\n")


def test_a_status_that_is_relayed(launcher: Launcher, tmp_path: Path) -> None:
    for status, told in ((139, -11), (134, -6), (127, 127), (3, 3), (255, 255)):
        env, words = dict(os.environ), ["sh", "-c", f"exit {status}"]
        process = launcher.start("part", words, env=env, cwd=tmp_path, directory=tmp_path, relayed=True)
        assert launcher.wait([process], timeout=WAIT_S)
        assert process.status == told


def test_limits_hold_for_processes_that_are_included(launcher: Launcher, tmp_path: Path) -> None:
    code = "x = bytes([1]) * (200 << 20); input()"
    with subprocess.Popen([sys.executable, "-S", "-c", code], stdin=subprocess.PIPE) as other:
        limits = {"memory": 100 << 20, "files": 0, "processes": 0, "cpu": 0}
        env, words = dict(os.environ), ["sleep", "93.5"]
        process = launcher.start("part", words, env=env, cwd=tmp_path, directory=tmp_path, limits=limits)
        launcher.include(process, [other.pid])
        assert launcher.wait([process], timeout=WAIT_S)
        assert process.excess is not None
        assert process.excess[0] == "memory"
        assert other.wait(WAIT_S) == -signal.SIGKILL


def test_limits_hold_for_who_keeps_the_supervisor_busy(launcher: Launcher, tmp_path: Path) -> None:
    """Each child that ends wakes the supervisor, far more often than it looks at limits."""
    limits = {"memory": 100 << 20, "files": 0, "processes": 0, "cpu": 0}
    orphans = "while True:\n    if not os.fork():\n        os.fork()\n        os._exit(0)\n    os.wait()"
    code = f"import os\nx = bytes([1]) * (200 << 20)\n{orphans}"
    process = launcher.start(
        "part",
        [sys.executable, "-S", "-c", code],
        env=dict(os.environ),
        cwd=tmp_path,
        directory=tmp_path,
        limits=limits,
    )
    assert launcher.wait([process], timeout=WAIT_S)
    assert process.excess is not None
    assert process.excess[0] == "memory"


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
