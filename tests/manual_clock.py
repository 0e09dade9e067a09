"""A clock for tests that never wait."""

from __future__ import annotations


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
