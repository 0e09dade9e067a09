"""Counts of recorded and unrecorded messages, by topic and reason."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from riot_bus.log.account import Account
from riot_bus.router.counts import BoundedCounts

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

__all__ = ["LossCounts", "summed"]


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
