"""What is certain of threads that sleep, as the kernel tells it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from riot_bus.sut.activity import Activity, Threads
from riot_bus.sut.rest import is_at_rest, waits_for_input
from riot_bus.zenoh.session import wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator

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
