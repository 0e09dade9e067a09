"""Provides time to a player: a clock on which commands can interrupt a wait."""

from __future__ import annotations

import threading
import time
from typing import Protocol

_SPIN_NS = 150_000  # threads wake 50 to 100 us late; more would only cost processor time
_IDLE_S = 3600.0  # callers wait again; at slow rates, waits could exceed threading.TIMEOUT_MAX (292 years)


class Pace(Protocol):
    """The source of a player's time."""

    def now(self) -> int:
        """Return nanoseconds since the Unix epoch."""

    def wait(self, bell: threading.Condition, until: int | None) -> None:
        """Wait until `now()` is `until` (nanoseconds), or the bell is notified; may return a little earlier.

        The caller holds the bell; without a time, only the bell ends the wait.
        """


class SteadyPace:
    """The machine's time, without jumps when its clock is set; exact to some 10 us, as waits end in a busy loop."""

    def __init__(self) -> None:
        self._offset = time.time_ns() - time.monotonic_ns()

    def now(self) -> int:
        """Return nanoseconds since the Unix epoch, by the clock as it was set at first."""
        return time.monotonic_ns() + self._offset

    def wait(self, bell: threading.Condition, until: int | None) -> None:
        """Wait until `now()` is `until` or the bell is notified; may return a little earlier."""
        if until is None:
            bell.wait(_IDLE_S)
            return
        until -= self._offset
        remaining = until - time.monotonic_ns()
        if remaining > _SPIN_NS:
            bell.wait(min((remaining - _SPIN_NS) / 1e9, _IDLE_S))
        else:
            while time.monotonic_ns() < until:
                pass
