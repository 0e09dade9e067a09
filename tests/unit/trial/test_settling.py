"""Settling on a machine that is busy with other things, and of components that never stand still."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import pytest

from riot_bus.processes.activity import Activity, Idle, Threads, idle_between
from riot_bus.trial.settling import is_at_rest, wait_settled, waits_for_input
from riot_bus.zenoh.session import wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator

Start = Callable[[str], int]
SPIN = "while True: pass"
TICK = "while True: time.sleep(0.003)"
RIVALS = 3
PATIENCE_S = 60.0
WINDOW_S = 0.05
LOCK = b"202 0x7fbfd8000e18 0x89 0xffffffff 0x0 0x0 0x0 0x7f 0x7f"
CASES = {
    "runs": (b"python", b"running", False),
    "not ours to know": (b"python", b"", False),
    "in no call": (b"python", b"-1 0x7f 0x7f", False),
    "a lock": (b"python", LOCK, True),
    "a lock for a time": (b"python", LOCK.replace(b"0x0 0x0 0x0", b"0x7fff10 0x0 0x0"), False),
    "a lock of several processes": (b"python", LOCK.replace(b"0x89", b"0x9"), False),
    "a sleep": (b"python", b"230 0x0 0x0 0x7ffc 0x7ffc 0x0 0x0 0x7f 0x7f", False),
    "a file": (b"python", b"0 0x14 0x55 0x2000 0x0 0x0 0x0 0x7f 0x7f", False),
    "an event loop": (b"python", b"232 0x3 0x55 0x400 0xffffffff 0x0 0x0 0x7f 0x7f", False),
    "Zenoh's sockets": (b"app-0", b"232 0x3 0x55 0x400 0xffffffff 0x0 0x0 0x7f 0x7f", True),
    "Zenoh's timers": (b"tx-0", b"232 0x3 0x55 0x400 0x9b8 0x0 0x0 0x7f 0x7f", True),
    "Zenoh's timers, soon": (b"tx-0", b"232 0x3 0x55 0x400 0x2 0x0 0x0 0x7f 0x7f", False),
    "a sleep in Zenoh's thread": (b"rx-0", b"230 0x0 0x0 0x7ffc 0x7ffc 0x0 0x0 0x7f 0x7f", False),
}


@pytest.fixture
def start() -> Iterator[Start]:
    """Start a Python program on one processor, which it shares with all others of the test; return its id."""
    (processor, *_) = sorted(os.sched_getaffinity(0))
    with ExitStack() as stack:

        def run(code: str) -> int:
            pinned = f"import os, sys, time; os.sched_setaffinity(0, {{{processor}}}); print(flush=True)\n{code}"
            process = stack.enter_context(
                subprocess.Popen([sys.executable, "-S", "-c", pinned], stdout=subprocess.PIPE, text=True)
            )
            stack.callback(process.kill)
            assert process.stdout is not None
            process.stdout.readline()
            return process.pid

        yield run


def idle_of(pid: int, seconds: float = 0.5) -> Idle:
    threads = Threads([pid])
    begin, before = time.monotonic(), threads.activity()
    time.sleep(seconds)
    return idle_between(before, threads.activity(), seconds=time.monotonic() - begin)


def test_waiting_for_a_processor_is_no_hang(start: Start) -> None:
    for _ in range(RIVALS):
        start(SPIN)
    worker = start("while time.process_time() < 0.8: pass\ntime.sleep(600)")
    begin = time.monotonic()
    assert wait_settled(Threads([worker]), window=0.05, timeout=2.0)
    assert time.monotonic() - begin > 2.0


def test_a_hang_on_a_busy_machine_is_one(start: Start) -> None:
    start(SPIN)
    assert not wait_settled(Threads([start(SPIN)]), window=0.05, timeout=0.5)


def test_timers_on_a_busy_machine_are_no_work(start: Start) -> None:
    ticker = start(TICK)
    idle = idle_of(ticker)
    assert idle.switches > 20
    for _ in range(RIVALS):
        start(SPIN)
    assert wait_settled(Threads([ticker]), window=0.15, timeout=5.0, idle=idle)


def test_work_beside_timers_is_work(start: Start) -> None:
    ticker = start(TICK)
    idle = idle_of(ticker)
    steady = (
        "while True:\n end = time.process_time() + 0.05\n while time.process_time() < end: pass\n time.sleep(0.003)"
    )
    worker = start(steady)
    assert wait_until(lambda: Threads([worker]).activity().ran_since(Activity({})) > 0.2, PATIENCE_S)
    assert not wait_settled(Threads([worker]), window=0.15, timeout=1.5, idle=idle)


class HeldUp(Threads):
    """Others have the processor for two windows after every other look."""

    looks = itertools.count()

    def activity(self) -> Activity:
        seen = super().activity()
        if next(self.looks) % 2:
            time.sleep(2 * WINDOW_S)
        return seen


def test_who_is_held_up_while_looking_takes_no_pause_for_rest(start: Start) -> None:
    ticker = start("while True: time.sleep(0.02)")
    assert not wait_settled(HeldUp([ticker]), window=WINDOW_S, timeout=1.0)


def test_the_window_begins_when_a_long_run_is_over(start: Start) -> None:
    run = "while True:\n end = time.process_time() + 0.1\n while time.process_time() < end: pass\n time.sleep(0.02)"
    assert not wait_settled(Threads([start(run)]), window=WINDOW_S, timeout=1.0)


@pytest.mark.skipif(os.uname().machine != "x86_64", reason="the lines are those of x86-64")
@pytest.mark.parametrize("case", CASES)
def test_what_a_thread_waits_for(case: str) -> None:
    name, call, expected = CASES[case]
    assert waits_for_input(name, call, window=0.03) is expected


@contextmanager
def program(code: str) -> Iterator[Threads]:
    """Start a Python program and wait until it says so."""
    with subprocess.Popen([sys.executable, "-S", "-c", code], stdout=subprocess.PIPE, text=True) as process:
        threads = Threads([process.pid])
        try:
            assert process.stdout is not None
            process.stdout.readline()
            yield threads
        finally:
            threads.close()
            process.kill()


BEGUN = "import threading, time\nready = threading.Event()\n"


WAITS = BEGUN + "print(flush=True)\nready.wait()"


SLEEPS = BEGUN + "threading.Thread(target=ready.wait).start()\nprint(flush=True)\ntime.sleep(60)"


@pytest.mark.skipif(os.uname().machine not in ("x86_64", "aarch64"), reason="nothing is certain elsewhere")
def test_a_program_that_waits_is_at_rest_and_one_that_sleeps_is_not() -> None:
    with program(WAITS) as waits, program(SLEEPS) as sleeps:
        assert wait_until(lambda: not waits.busy() and is_at_rest(waits, since=Activity({}), window=0.03), 30.0)
        assert wait_until(lambda: not sleeps.busy(), 30.0)
        assert not is_at_rest(sleeps, since=Activity({}), window=0.03)
        before = sleeps.activity()
        assert is_at_rest(sleeps, since=before, window=0.03)  # it has slept all the time


def test_a_process_that_is_gone_is_not_at_rest() -> None:
    assert not is_at_rest(Threads([2**22 + 1]), since=Activity({}), window=0.03)


def test_the_thread_that_looks_is_left_out() -> None:
    threads = Threads([os.getpid()], but=threading.get_native_id())
    assert threading.get_native_id() not in threads.activity().threads
    threads.close()
