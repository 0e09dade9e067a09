"""Settling on a machine that is busy with other things, and of components that never stand still."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from riot_bus.sut.activity import Activity, Idle, Threads, idle_between
from riot_bus.sut.settling import wait_settled
from riot_bus.zenoh.session import wait_until

Start = Callable[[str], int]
SPIN = "while True: pass"
TICK = "while True: time.sleep(0.003)"
RIVALS = 3
PATIENCE_S = 60.0
WINDOW_S = 0.05


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
