"""What processes have done, as the kernel tells it."""

from __future__ import annotations

import os
import threading
import time

import pytest

from riot_bus.sut.activity import STILL, Activity, Idle, Shares, activity, families, idle_between, shares

NOBODY = 2**22 + 1


def test_processes_that_are_gone_do_nothing() -> None:
    assert activity([NOBODY]) == Activity(0, busy=False)
    assert shares([NOBODY]) == Shares({}, {})
    assert families([NOBODY]) == [NOBODY]


def test_own_work_is_seen() -> None:
    before, switches = shares([os.getpid()]), activity([os.getpid()]).switches
    end = time.process_time() + 0.05
    while time.process_time() < end:
        pass
    woken = threading.Event()
    thread = threading.Thread(target=woken.wait)
    thread.start()
    woken.set()
    thread.join()
    assert shares([os.getpid()]).ran_since(before) >= 0.03  # the kernel counts up in ticks
    assert activity([os.getpid()]).busy
    assert activity([os.getpid()]).switches >= switches


def test_shares_are_told_by_thread() -> None:
    before, after = Shares({1: 1.0}, {1: 0.5}), Shares({1: 1.5, 2: 0.25}, {1: 0.75, 2: 1.0})
    assert after.ran_since(before) == 0.75
    assert after.waited_since(before) == 1.0
    assert Shares({}, {}).waited_since(before) == 0.0


@pytest.mark.parametrize(
    ("waited", "expected"), [(0.0, Idle(50.0, 0.125)), (1.0, Idle(100.0, 0.25)), (2.0, Idle(500.0, 1.25))]
)
def test_time_without_a_processor_does_not_count(waited: float, expected: Idle) -> None:
    before = Activity(100, busy=False), Shares({1: 0.0}, {1: 0.0})
    after = Activity(200, busy=True), Shares({1: 0.25}, {1: waited})
    assert idle_between(before, after, seconds=2.0) == expected


def test_the_more_of_both() -> None:
    assert Idle(1.0, 0.5).or_more(Idle(2.0, 0.25)) == Idle(2.0, 0.5)
    assert STILL.or_more(Idle(1.0, 0.5)) == Idle(1.0, 0.5)
