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
