"""Gaps in the numbers that publishers give their messages: what was lost before it could be recorded."""

from __future__ import annotations

from collections.abc import Hashable

_MOST_PUBLISHERS = 10_000  # any client may invent publishers: bounds the memory; further ones are not followed
_MOST_REMEMBERED = 1000  # missing numbers of a publisher; one farther back means that it has restarted


class _Run:
    __slots__ = ("last", "missing")

    def __init__(self, number: int) -> None:
        self.last = number
        self.missing: set[int] | None = None


class Gaps:
    """Tracking of publishers' numbers; a message that comes late is no longer missing.

    Attributes:
        untold: Whether there are more publishers than can be followed.
    """

    def __init__(self) -> None:
        self.untold = False
        self._runs: dict[Hashable, _Run] = {}

    def see(self, publisher: Hashable, number: int) -> int:
        """Register a message, and return how many more are missing than before (less than 0 if it came late).

        Args:
            publisher: Publisher that has numbered it.
            number: Its number; the first one starts the sequence, and a much smaller one restarts it.
        """
        run = self._runs.get(publisher)
        if run is None:
            if len(self._runs) >= _MOST_PUBLISHERS:
                self.untold = True
                return 0
            self._runs[publisher] = _Run(number)
            return 0
        step = number - run.last
        if step == 1:
            run.last = number
            return 0
        if step > 1:
            missing = run.missing = run.missing or set()
            missing.update(range(max(run.last + 1, number - _MOST_REMEMBERED), number))
            if len(missing) > _MOST_REMEMBERED:
                run.missing = set(sorted(missing)[-_MOST_REMEMBERED:])
            run.last = number
            return step - 1
        if run.missing is not None and number in run.missing:
            run.missing.discard(number)
            return -1
        if step < -_MOST_REMEMBERED or number <= 1:  # it has restarted, or its numbers wrapped around
            run.last, run.missing = number, None
        return 0
