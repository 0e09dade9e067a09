"""What processes have done, as the kernel tells it."""

from __future__ import annotations

import os
import subprocess
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from riot_bus.processes import activity
from riot_bus.processes.activity import STILL, Activity, Idle, Threads, families, idle_between
from riot_bus.zenoh.session import wait_until

NOBODY = 2**22 + 1
MS = 10**6
WAIT_S = 60.0


@pytest.fixture(autouse=True)
def closed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Close all files in the end: a process with Zenoh has hundreds of threads, and `select` takes 1,024 files."""
    made: list[Threads] = []
    init = Threads.__init__

    def noted(self: Threads, *args: Any, **options: Any) -> None:
        made.append(self)
        init(self, *args, **options)

    monkeypatch.setattr(Threads, "__init__", noted)
    yield
    for each in made:
        each.close()


def test_processes_that_are_gone_do_nothing() -> None:
    assert Threads([NOBODY]).activity() == Activity({})
    assert not Threads([NOBODY]).busy()
    assert families([NOBODY]) == [NOBODY]


def test_own_work_is_seen() -> None:
    threads = Threads([os.getpid()])
    before = threads.activity()
    end = time.process_time() + 0.05
    while time.process_time() < end:
        pass
    woken = threading.Event()
    thread = threading.Thread(target=woken.wait)
    thread.start()
    woken.set()
    thread.join()
    assert threads.activity().ran_since(before) >= 0.03  # the kernel counts up in ticks
    assert threads.busy()
    assert threads.activity().switches >= before.switches
    threads.close()


@pytest.mark.parametrize("tells_times", [True, False])
def test_who_sleeps_rests_until_it_has_run(tells_times: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the kernel counts no nanoseconds, context switches have to do."""
    monkeypatch.setattr(activity, "_TELLS_TIMES", tells_times)
    with subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as echo:
        assert echo.stdin
        assert echo.stdout
        threads, still = Threads([echo.pid]), list[int]()

        def rests() -> bool:
            still[:] = [threads.ran()]
            return threads.rests(still[0])

        for _ in range(50):
            assert wait_until(rests, WAIT_S)
            echo.stdin.write(b"a")
            echo.stdin.flush()
            assert echo.stdout.read(1) == b"a"
            assert not threads.rests(still[0])
            assert wait_until(lambda: threads.ran() > still[0], WAIT_S)
        ran = threads.ran()
        echo.kill()
    assert threads.ran() >= ran if tells_times else threads.ran() == 0
    threads.close()


def test_threads_of_one_process_rest_one_by_one() -> None:
    """The thread that asks runs, and the others do not."""
    woken, end = threading.Event(), threading.Event()
    more = threading.Thread(target=lambda: woken.wait() and end.wait())
    more.start()
    others = Threads([os.getpid()], but=threading.get_native_id())
    assert wait_until(lambda: others.rests(others.ran()), WAIT_S)
    before = others.ran()
    woken.set()
    assert wait_until(lambda: others.ran() > before, WAIT_S)
    assert not others.rests(before)
    end.set()
    more.join()
    others.close()


def test_threads_that_begin_and_end_are_followed() -> None:
    files, threads, end = len(os.listdir("/proc/self/fd")), Threads([os.getpid()]), threading.Event()
    threads.activity()
    more = threading.Thread(target=end.wait)
    more.start()
    assert more.native_id in threads.activity().threads
    end.set()
    more.join()
    assert wait_until(lambda: more.native_id not in threads.activity().threads, WAIT_S)  # the kernel is a moment behind
    threads.close()
    assert len(os.listdir("/proc/self/fd")) == files


def test_a_thread_that_takes_the_place_of_another_is_seen() -> None:
    threads, ends = Threads([os.getpid()]), [threading.Event() for _ in range(2)]
    first, second = (threading.Thread(target=end.wait) for end in ends)
    first.start()
    assert first.native_id in threads.activity().threads
    ends[0].set()
    first.join()
    assert wait_until(lambda: not os.path.exists(f"/proc/self/task/{first.native_id}"), WAIT_S)
    second.start()  # so there are as many as before
    assert second.native_id in threads.activity().threads
    ends[1].set()
    second.join()
    threads.close()


def test_children_of_any_thread_belong_to_the_family() -> None:
    alone, end = Threads([os.getpid()]), threading.Event()
    found: list[subprocess.Popen[bytes]] = []

    def start() -> None:
        found.append(subprocess.Popen(["sleep", "60"]))
        end.wait()

    before = families([os.getpid()])
    assert Threads(before).has_all_of([os.getpid()])
    thread = threading.Thread(target=start)
    thread.start()
    assert wait_until(lambda: bool(found), WAIT_S)
    try:
        assert not alone.has_all_of([os.getpid()])
        both = Threads(families([os.getpid()]))
        assert found[0].pid in both.pids
        assert both.has_all_of([os.getpid()])
    finally:
        found[0].kill()
        found[0].wait()
        end.set()
        thread.join()
    assert not both.has_all_of([os.getpid()])
    alone.close()
    both.close()


def test_shares_are_told_by_thread() -> None:
    before = Activity({1: (10**9, 500 * MS, 3)})
    after = Activity({1: (1500 * MS, 750 * MS, 4), 2: (250 * MS, 10**9, 1)})
    assert after.ran_since(before) == 0.75
    assert after.waited_since(before) == 1.0
    assert Activity({}).waited_since(before) == 0.0


@pytest.mark.parametrize(
    ("waited", "expected"), [(0.0, Idle(50.0, 0.125)), (1.0, Idle(100.0, 0.25)), (2.0, Idle(500.0, 1.25))]
)
def test_time_without_a_processor_does_not_count(waited: float, expected: Idle) -> None:
    before, after = Activity({1: (0, 0, 100)}), Activity({1: (250 * MS, round(waited * 1e9), 200)})
    assert idle_between(before, after, seconds=2.0) == expected


def test_the_more_of_both() -> None:
    assert Idle(1.0, 0.5).or_more(Idle(2.0, 0.25)) == Idle(2.0, 0.5)
    assert STILL.or_more(Idle(1.0, 0.5)) == Idle(1.0, 0.5)
