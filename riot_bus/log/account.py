"""Counts what a recording contains and lacks; the log itself holds them as the metadata record `riot_bus.lost`."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from riot_bus.pipeline.runner import BoundedCounts

LOST = "riot_bus.lost"
_VERSION = 1
_MOST_TOPICS = 10_000  # eight tables of 80 bytes a topic stay below 8 MiB, an agent's limit
_OTHER = "(other topics)"

Numbers = Mapping[str, int]
"""Messages by topic."""


@dataclass(frozen=True, slots=True)
class Account:
    """Numbers of messages by topic and, if they are not in the log, by reason; false if none is lost.

    Attributes:
        recorded: Messages that were written.
        lost: Messages that should have been written, by reason: `disk` (full or broken), `too slow` (the disk),
            `no room` (in the queue before the disk), `refused` (more keys or other times than a log can hold),
            `missed` (gaps in the numbers that publishers give: the messages never arrived).
        left_out: Messages that were not wanted, by reason: `paused`, `throttled`.
    """

    recorded: Numbers = field(default_factory=dict)
    lost: Mapping[str, Numbers] = field(default_factory=dict)
    left_out: Mapping[str, Numbers] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return any(number > 0 for topics in self.lost.values() for number in topics.values())

    def total(self, reason: str | None = None) -> int:
        """Return how many messages are lost for a reason, or for any."""
        return sum(number for name, topics in self.lost.items() if reason in (None, name) for number in topics.values())

    @classmethod
    def total_of(cls, accounts: Sequence[Account]) -> Account:
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

    def renamed(self, names: Mapping[str, str]) -> Account:
        """Return the numbers of some topics under other names; those without a new name are left out."""

        def kept(numbers: Numbers) -> Counter[str]:
            total: Counter[str] = Counter()
            for topic, number in numbers.items():
                total.update({names[topic]: number} if topic in names else {})
            return total

        return Account(
            kept(self.recorded),
            {reason: kept(topics) for reason, topics in self.lost.items()},
            {reason: kept(topics) for reason, topics in self.left_out.items()},
        )

    def record(self) -> dict[str, str]:
        """Return it as the mapping of a metadata record."""
        return {
            "version": str(_VERSION),
            "recorded": json.dumps(_few(self.recorded)),
            "lost": _by_reason(self.lost),
            "left_out": _by_reason(self.left_out),
        }


class LossCounts:
    """The counts of one file in bounded memory; not thread-safe.

    Attributes:
        recorded: Messages by topic that are in the file, or on their way to it.
        lost: Messages by reason and topic that are not in the file.
        left_out: Messages by reason and topic that were not wanted.
    """

    def __init__(self) -> None:
        self.recorded = BoundedCounts()
        self.lost: defaultdict[str, BoundedCounts] = defaultdict(BoundedCounts)
        self.left_out: defaultdict[str, BoundedCounts] = defaultdict(BoundedCounts)

    def lose(self, reason: str, topic: str, number: int = 1, *, written: bool = False) -> None:
        """Count lost messages; `written`: they were counted as recorded."""
        self.lost[reason].add(topic, number)
        if written:
            self.recorded.add(topic, -number)

    def account(self) -> Account:
        """Return all counts."""
        return Account(
            _present(self.recorded),
            *(
                {reason: numbers for reason, topics in [*part.items()] if (numbers := _present(topics))}
                for part in (self.lost, self.left_out)
            ),
        )


def account_of(record: Mapping[str, str]) -> Account | None:
    """Read a metadata record; None if it is damaged or of another version.

    Args:
        record: Record that `LogReader.notes(LOST)` yields; the last one of a log counts.
    """
    try:
        if record["version"] != str(_VERSION):
            return None
        recorded, lost, left_out = (json.loads(record[name]) for name in ("recorded", "lost", "left_out"))
        return Account(
            _numbers(recorded),
            {str(reason): _numbers(topics) for reason, topics in lost.items()},
            {str(reason): _numbers(topics) for reason, topics in left_out.items()},
        )
    except (KeyError, ValueError, TypeError, AttributeError, RecursionError):
        return None


def _by_reason(table: Mapping[str, Numbers]) -> str:
    return json.dumps({reason: _few(topics) for reason, topics in table.items() if any(topics.values())})


def _numbers(document: Any) -> dict[str, int]:
    found = {str(topic): number for topic, number in document.items()}
    if not all(isinstance(number, int) for number in found.values()):
        raise ValueError("counts must be numbers")
    return found


def _present(numbers: Numbers) -> dict[str, int]:
    return {topic: number for topic, number in dict(numbers).items() if number}


def _few(numbers: Numbers) -> dict[str, int]:
    found = _present(numbers)
    if len(found) > _MOST_TOPICS:
        ordered = sorted(found.items(), key=lambda each: each[1], reverse=True)
        found = dict(ordered[:_MOST_TOPICS])
        found[_OTHER] = found.get(_OTHER, 0) + sum(number for _, number in ordered[_MOST_TOPICS:])
    return dict(sorted(found.items()))
