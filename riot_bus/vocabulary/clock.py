"""Clocks, which are passed as arguments so that tests and offline runs never wait."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A source of time."""

    def now(self) -> int:
        """Return nanoseconds since the Unix epoch."""
        ...

    def sleep_until(self, when: int) -> None:
        """Block until `now()` is at least `when` (nanoseconds); return at once when it already is."""
        ...


class SystemClock:
    """The machine's clock."""

    def now(self) -> int:
        """Return nanoseconds since the Unix epoch."""
        return time.time_ns()

    def sleep_until(self, when: int) -> None:
        """Block until the machine's clock has reached `when`."""
        remaining = when - time.time_ns()
        if remaining > 0:
            time.sleep(remaining / 1e9)


class ManualClock:
    """A clock that stands still until it is moved; sleeping moves it."""

    def __init__(self, start: int = 0) -> None:
        self._now = start

    def now(self) -> int:
        """Return the time that was set."""
        return self._now

    def sleep_until(self, when: int) -> None:
        """Jump to `when`, never backwards."""
        self._now = max(self._now, when)

    def advance(self, nanoseconds: int) -> None:
        """Move the clock forward."""
        self._now += nanoseconds
