"""Ends that no thread can hold up, in processes of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

_BUSY = """
import re, signal, sys, threading, time
from riot_bus.control import signals
{before}
def wait():
    print("ready", flush=True)
    {work}
with signals.ended_by_signals(lambda: None, deadline=0.5):
    wait()
"""


@pytest.mark.parametrize("work", ["time.sleep(1000)", "threading.Event().wait()", "while True: pass"])
def test_work_that_does_not_end_is_ended_at_the_deadline(work: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", _BUSY.format(before="", work=work)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "Timeout (0:00:00.5" in err
    assert "in wait" in err, "it says what was going on"


def test_an_interpreter_that_is_held_up_does_not_hold_up_the_end() -> None:
    code = """
import re, threading
from riot_bus.control.signals import force_end_after
force_end_after(0.5)
print("ready", flush=True)
re.fullmatch("(a*)*b", "a" * 100)  # holds the interpreter for longer than the sun shines
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "Timeout" in done.stderr


def test_an_end_in_time_is_not_forced() -> None:
    code = _BUSY.format(before="", work="os = __import__('os'); os.kill(os.getpid(), signal.SIGTERM)")
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\ntime.sleep(1)\nprint('alive')"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env=os.environ,
    )
    assert (done.returncode, done.stdout.splitlines()[-1], done.stderr) == (0, "alive", "")


def test_a_command_ends_although_a_thread_does_not() -> None:
    code = """
import sys, threading
from riot_bus.cli import main
main._END_S = 0.5
threading.Thread(target=threading.Event().wait).start()
sys.argv = ["riot", "--version"]
main.run()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "Timeout" in done.stderr


def test_a_router_that_does_not_close_is_ended() -> None:
    code = """
import os, signal, threading, time
from riot_bus.control.router_process import Upkeep
from riot_bus.control.signals import ended_by_signals
stopping = threading.Event()
with ended_by_signals(stopping.set, deadline=0.5):
    upkeep = Upkeep()
    os.kill(os.getpid(), signal.SIGTERM)
    while not stopping.wait(0.05):
        upkeep()
    threading.Event().wait()  # closing
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, "Timeout (0:00:00.5" in done.stderr) == (1, True), done.stderr
