"""The counts of a bus: messages received and forwarded per topic, the reasons for the difference, and losses."""

from __future__ import annotations

import logging
import threading
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from riot_bus.pipeline.runner import BoundedCounts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from riot_bus.pipeline.runner import Counts
    from riot_bus.zenoh.link_watch import BrokenLink

_LOG = logging.getLogger(__name__)


class RouteCounts:
    """Counts of the messages of one route; the thread that forwards them increments these, without a lock.

    Attributes:
        passed: Number of messages forwarded without inspection.
        seen: Number of messages that the pipeline or the recorder inspected.
        rewritten: Number of messages changed by a function that does all that the interceptors do.
        reported: Number of rewritten messages that the pipeline has counted.
    """

    def __init__(self, key: str) -> None:
        self.key = key
        self.passed = self.seen = self.rewritten = self.reported = 0

    @property
    def received(self) -> int:
        """Number of all intercepted messages."""
        return self.passed + self.seen + self.rewritten


class ForwarderCounts:
    """Counts of a forwarder's messages by key: those of its present routes, and the sums of those that ended."""

    def __init__(self, rewrote: Callable[[str, int], None]) -> None:
        self._rewrote = rewrote
        self._lock = threading.Lock()
        self._passed, self._received = BoundedCounts(), BoundedCounts()

    def report(self, route: RouteCounts) -> None:
        """Tell the pipeline about the messages that were rewritten since the last report."""
        with self._lock:
            number = route.rewritten - route.reported
            route.reported += number
        if number:
            try:
                self._rewrote(route.key, number)
            except Exception:  # the interceptor's fault, which must not end the forwarder's thread
                _LOG.exception("an interceptor of %s could not count what it did", route.key)

    def end(self, route: RouteCounts) -> None:
        """Add up the counts of a route that is not used any more."""
        self.report(route)
        self._passed.add(route.key, route.passed)
        self._received.add(route.key, route.received)

    def passed(self, routes: Iterable[RouteCounts]) -> Counter[str]:
        """Return how many messages per key were forwarded without inspection, including those of present routes."""
        counts = Counter(self._passed)
        for route in routes:
            counts[route.key] += route.passed
        return +counts

    def received(self, routes: Iterable[RouteCounts]) -> Counter[str]:
        """Return how many messages per key were received, including those of present routes."""
        counts = Counter(self._received)
        for route in routes:
            counts[route.key] += route.received
        return +counts


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
    """Return counts by topic; all arguments are by topic, too."""
    table: dict[str, TopicCounts] = {}
    for topic, each in list(looked_at.items()):
        if each.seen or each.added:
            table[topic] = TopicCounts(
                received=each.seen,
                changed=each.changed,
                added=each.added + each.copies,
                forwarded=each.delivered,
                dropped=each.dropped,
            )
    for numbers, signs in (
        (passed, {"received": 1, "forwarded": 1}),
        (shed, {"received": 1, "lost": 1}),
        (undelivered, {"lost": 1, "forwarded": -1}),
        (held, {"held": 1, "forwarded": -1}),
        (recorded, {"recorded": 1}),
        (unrecorded, {"unrecorded": 1}),
    ):
        for topic, number in numbers.items():
            counts = table.setdefault(topic, TopicCounts())
            for name, sign in signs.items():
                setattr(counts, name, getattr(counts, name) + sign * number)
    return dict(sorted(table.items()))
