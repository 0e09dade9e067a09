"""Account of a recording's losses: counts by topic and reason, and gaps in the numbers that publishers give."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable
from typing import TYPE_CHECKING

from riot_bus.log.account import Account
from riot_bus.pipeline.runner import BoundedCounts

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

_MOST_PUBLISHERS = 10_000  # any client may invent publishers: bounds the memory; further ones are not followed
_MOST_REMEMBERED = 1000  # missing numbers of a publisher; one farther back means that it has restarted


class LossCounts:
    """The counts of one file; not thread-safe.

    Attributes:
        recorded: Number of written messages by topic, including those that were lost afterwards.
        lost: Number of messages, by reason and topic, that are not in the file.
        unwritten: Number of lost messages, by topic, that `recorded` includes.
        left_out: Number of unwanted messages, by reason and topic.
    """

    def __init__(self) -> None:
        self.recorded = BoundedCounts()
        self.unwritten = BoundedCounts()
        self.lost: defaultdict[str, BoundedCounts] = defaultdict(BoundedCounts)
        self.left_out: defaultdict[str, BoundedCounts] = defaultdict(BoundedCounts)

    def lose(self, reason: str, topic: str, number: int = 1, *, written: bool = False) -> None:
        """Count lost messages; `written`: they were counted as recorded."""
        self.lost[reason].add(topic, number)
        if written:
            self.unwritten.add(topic, number)

    def account(self) -> Account:
        """Return all counts."""
        recorded = {topic: number - self.unwritten.get(topic, 0) for topic, number in self.recorded.copy().items()}
        return Account(
            {topic: number for topic, number in recorded.items() if number},
            _plain(self.lost),
            _plain(self.left_out),
        )


def summed(accounts: Iterable[Account]) -> Account:
    """Return the sum of several accounts."""
    total = LossCounts()
    for account in accounts:
        for topic, number in account.recorded.items():
            total.recorded.add(topic, number)
        for part, found in ((account.lost, total.lost), (account.left_out, total.left_out)):
            for reason, topics in part.items():
                for topic, number in topics.items():
                    found[reason].add(topic, number)
    return total.account()


def _plain(parts: Mapping[str, BoundedCounts]) -> dict[str, dict[str, int]]:
    found = {
        reason: {topic: number for topic, number in topics.copy().items() if number}
        for reason, topics in list(parts.items())
    }
    return {reason: topics for reason, topics in found.items() if topics}


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
