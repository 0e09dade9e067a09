"""The counts of a bus: messages received and forwarded per topic, the reasons for the difference, and losses."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from riot_bus.pipeline.runner import MOST_TOPICS, OTHER_TOPICS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.pipeline.runner import Counts
    from riot_bus.zenoh.link_watch import BrokenLink

__all__ = ["BoundedCounts", "Losses", "TopicCounts", "count"]


class BoundedCounts(Counter[str]):
    """Counts by topic or key in bounded memory: once there are too many topics, new ones share one count."""

    def add(self, topic: str, number: int = 1) -> None:
        """Add to the count of a topic."""
        if topic not in self and len(self) >= MOST_TOPICS:
            topic = OTHER_TOPICS
        self[topic] += number


@dataclass(slots=True)
class TopicCounts:
    """What happened to one topic: `received + added == forwarded + dropped + lost + held`.

    Attributes:
        received: Messages that came from a segment.
        changed: Received messages that interceptors changed.
        added: Messages that interceptors added, copies included.
        forwarded: Messages that were published for the other segments.
        dropped: Messages that interceptors dropped.
        lost: Messages that were dropped for other reasons; `Losses` has the reasons.
        held: Messages that wait until they are due.
        recorded: Messages that were recorded, including those that were only observed.
        unrecorded: Messages that should have been recorded but were not.
    """

    received: int = 0
    changed: int = 0
    added: int = 0
    forwarded: int = 0
    dropped: int = 0
    lost: int = 0
    held: int = 0
    recorded: int = 0
    unrecorded: int = 0


@dataclass(frozen=True, slots=True)
class Losses:
    """Unintended losses; false when there are none.

    Attributes:
        messages: Messages that were not delivered, by topic.
        recordings: Messages that were not recorded, by topic.
        links: Links that broke while they were needed.
        reasons: Messages that were not delivered, by reason.
    """

    messages: dict[str, int] = field(default_factory=dict)
    recordings: dict[str, int] = field(default_factory=dict)
    links: tuple[BrokenLink, ...] = ()
    reasons: dict[str, int] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.messages or self.recordings or self.links)


def count(
    looked_at: Mapping[str, Counts],
    *,
    passed: Mapping[str, int],
    shed: Mapping[str, int],
    undelivered: Mapping[str, int],
    held: Mapping[str, int],
    recorded: Mapping[str, int],
    unrecorded: Mapping[str, int],
) -> dict[str, TopicCounts]:
    """Return counts by topic; all arguments are by topic, too.

    Args:
        looked_at: What the pipeline decided about the messages that it saw.
        passed: Messages forwarded without inspection by the pipeline.
        shed: Messages that there was no room for.
        undelivered: Messages, passed or inspected, that could not be published.
        held: Messages that wait until they are due.
        recorded: Messages that were recorded.
        unrecorded: Messages that should have been recorded but were not.
    """
    table: dict[str, TopicCounts] = {}

    def row(topic: str) -> TopicCounts:
        return table.setdefault(topic, TopicCounts())

    for topic, each in list(looked_at.items()):
        if each.seen or each.added:
            counts = row(topic)
            counts.received, counts.changed, counts.dropped = each.seen, each.changed, each.dropped
            counts.added = each.added + each.copies
            counts.forwarded = each.delivered
    for topic, number in passed.items():
        row(topic).received += number
        row(topic).forwarded += number
    for topic, number in shed.items():
        row(topic).received += number
        row(topic).lost += number
    for topic, number in undelivered.items():
        row(topic).forwarded -= number
        row(topic).lost += number
    for topic, number in held.items():
        row(topic).held += number
        row(topic).forwarded -= number
    for topic, number in recorded.items():
        row(topic).recorded += number
    for topic, number in unrecorded.items():
        row(topic).unrecorded += number
    return dict(sorted(table.items()))
