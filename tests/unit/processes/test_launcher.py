"""What is read of a component's output; starting and ending: test_processes.py."""

from __future__ import annotations

import signal
import sys
import threading
from pathlib import Path

import psutil
import pytest

from riot_bus.processes import launcher
from riot_bus.processes.launcher import ComponentProcess, Launcher
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import wait_until


def process(folder: Path, *, stdout: bytes = b"", stderr: bytes = b"") -> ComponentProcess:
    out, err = folder / "part.out", folder / "part.err"
    out.write_bytes(stdout)
    err.write_bytes(stderr)
    return ComponentProcess("part", 1, out, err)


def test_early_output_is_read_however_much_comes_after_it(tmp_path: Path) -> None:
    one = process(tmp_path, stdout=b"first\n" + bytes(1 << 20), stderr=b"Traceback\n" + b"." * (1 << 20))
    assert one.printed().startswith("first\n")
    assert one.errors().startswith("Traceback\n")
    assert one.unread == 0


def test_of_too_much_the_begin_and_the_end_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launcher, "_HALF", 4)
    one = process(tmp_path, stdout=b"12345678", stderr=b"1234abc5678")
    assert (one.printed(), one.errors()) == ("12345678", "1234\n5678")
    assert one.unread == 3


def test_a_thread_that_waits_for_the_supervisor_does_not_delay_the_end(tmp_path: Path) -> None:
    problems: list[EnvironmentFaultError] = []

    def start() -> None:
        with pytest.raises(EnvironmentFaultError) as problem:
            components.start("part", ["true"], env={}, cwd=tmp_path, directory=tmp_path)
        problems.append(problem.value)

    def waits() -> bool:
        frame = sys._current_frames().get(starting.ident or 0)
        return frame is not None and frame.f_code is Launcher._pump.__code__

    before = set(psutil.Process().children())
    components = Launcher()
    (supervisor,) = set(psutil.Process().children()) - before
    starting = threading.Thread(target=start)
    supervisor.send_signal(signal.SIGSTOP)
    starting.start()
    assert wait_until(waits, 60)
    closing = threading.Thread(target=components.close)
    closing.start()
    starting.join(20)  # `_pump` looks again after 30 s
    assert not starting.is_alive()
    supervisor.send_signal(signal.SIGCONT)
    closing.join(60)
    assert not closing.is_alive()
    assert [str(each) for each in problems] == ["the supervisor of the components is gone"]
