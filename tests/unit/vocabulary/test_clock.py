from __future__ import annotations

import time

from riot_bus.vocabulary.clock import SystemClock
from tests.manual_clock import ManualClock


def test_a_clock_does_not_wait_for_what_has_passed() -> None:
    clock = SystemClock()
    begin = clock.now()
    clock.sleep_until(begin - 10**12)
    clock.sleep_until(begin + 1_000_000)
    assert begin + 1_000_000 <= clock.now() < begin + 10**12
    assert abs(clock.now() - time.time_ns()) < 10**10


def test_the_clock_of_tests_moves_only_forwards() -> None:
    clock = ManualClock(5)
    clock.sleep_until(3)
    clock.advance(1)
    clock.sleep_until(9)
    assert clock.now() == 9
