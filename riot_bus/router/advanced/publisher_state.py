"""State of one advanced publisher, with its messages that have to wait.

| state | live messages | event | next state |
|---|---|---|---|
| new (`holds` > 0) | wait | its history is stored, and the proxies exist | open (`opened`) |
| open | are sent | some numbers are missing, or a heartbeat is ahead | recovering (`holds` > 0) |
| recovering | wait | what the publisher still has is stored | open |
| open | are sent | it may have dropped its first sample | measuring (`checking`) |
| measuring | are sent | the depth of its cache is known, or cannot be found out | open |
| any | | its token or its session is gone | ended (`ended`), after the tasks before |

The transitions are tasks of `HistoryMirror`, one after the other for each publisher.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.pipeline.runner import Result
    from riot_bus.router.advanced.proxy_publisher import ProxyPublisher
    from riot_bus.router.advanced.source import AdvancedSource


class Task(NamedTuple):
    """A task for a publisher; if `holds`, live messages wait until it is done."""

    run: Callable[[], None]
    holds: bool


@dataclass(slots=True)
class Stored:
    """A sample of a history: the result of the interceptors, and the numbers under which it was stored."""

    result: Result | None = None
    places: list[tuple[ProxyPublisher, Message, int, Any]] = field(default_factory=list)


class SampleVerdict(NamedTuple):
    """What to do about a live sample.

    Attributes:
        stored: Stored sample to send instead, if it was stored already.
        late: Whether it is older than the history, so that it cannot be numbered.
        lost: First and last number of the samples before it that did not come.
        check: Whether it is time to ask how many samples the publisher keeps.
    """

    stored: Stored | None = None
    late: bool = False
    lost: tuple[int, int] | None = None
    check: bool = False


class PublisherState:
    """One advanced publisher. All but `tasks` and `ended` is guarded by `lock`.

    Args:
        again: Whether subscribers have had its history.
        token: Whether it shows a liveliness token.
    """

    def __init__(self, source: AdvancedSource, *, again: bool, token: bool) -> None:
        self.source, self.again, self.token = source, again, token
        self.lock = threading.RLock()
        self.outlets: dict[str, ProxyPublisher] = {}
        self.tasks: deque[Task] = deque()
        self.task: Task | None = None
        self.on_first: Callable[[], None] | None = None
        """What to do when the first live sample comes."""
        self.holds = 0
        self.pending: deque[tuple[str, Callable[[], None]] | None] = deque()
        """Messages that wait; None stands for a task that has to be done before the messages after it."""
        self.early: dict[int, Stored] = {}
        self.first: int | None = None
        self.last: int | None = None
        self.depth: int | None = None
        self.failures = 0
        self.check_from = 0.0
        self.busy = False
        """Whether a forwarder is taking a message through the interceptors."""
        self.opened = False
        """Whether the history is there."""
        self.ended = self.checking = self.unchecked = self.beats = self.near = False

    def arrived(self, number: int, now: float) -> SampleVerdict:
        """Register a live sample, and return what to do about it.

        Args:
            number: Its number, or its time if the publisher does not number its samples.
            now: Monotonic time, seconds.
        """
        with self.lock:
            stored, before = self.early.pop(number, None), self.last
            if self.first is None:
                self.first = number
            self.last = number if before is None else max(before, number)
            if stored is not None:
                return SampleVerdict(stored)
            if self.early and number > max(self.early):
                self.early.clear()
            elif self.early and not self.holds:  # a forwarder was very late: as an unnumbered message it is not refused
                return SampleVerdict(late=True)
            lost = None
            if self.source.numbered and before is not None and number > before + 1:
                lost = before + 1, number - 1
            self.unchecked = self.depth is None
            return SampleVerdict(lost=lost, check=lost is None and now >= self.check_from and self.overdue())

    def overdue(self) -> bool:
        """Return whether it is time to ask how many samples the publisher keeps; if so, mark this as being done."""
        with self.lock:
            due = self.unchecked and self.depth is None and not (self.checking or self.holds or self.ended)
            if due:
                self.checking, self.unchecked = True, False
            return due

    def claim(self, number: int) -> Stored:
        """Announce that a sample of the history will be stored; if it also comes live, it is not taken again."""
        self.first = number if self.first is None else min(self.first, number)
        self.last = number if self.last is None else max(self.last, number)
        stored = self.early[number] = Stored()
        return stored

    def deliver(self, key: str, action: Callable[[], None]) -> None:
        """Send a live message, as soon as nothing has to go before it.

        Args:
            key: Key of the message, for `held`.
            action: Function that sends it; must not raise.
        """
        with self.lock:
            if self.holds:
                self.pending.append((key, action))
            else:
                action()

    def hold(self) -> None:
        """Let messages that come from now on wait for a task."""
        with self.lock:
            self.holds += 1
            self.pending.append(None)

    def let_go(self) -> None:
        """Send the messages that have waited for the finished task, which is the first one."""
        with self.lock:
            self.holds -= 1
            self.pending.popleft()
            while self.pending and (first := self.pending[0]) is not None:
                self.pending.popleft()
                first[1]()

    def held(self) -> Counter[str]:
        """Return how many messages wait, by key."""
        return Counter(each[0] for each in list(self.pending) if each is not None)

    def publish(self, segment: str, message: Message) -> bool:
        """Publish in a segment; return False if the publisher has no proxy there."""
        with self.lock:
            proxy = self.outlets.get(segment)
            if proxy is None:
                return False
            proxy.publish(message)
            return True

    def skip(self, numbers: int) -> None:
        """Skip sequence numbers in all segments."""
        with self.lock:
            for proxy in self.outlets.values():
                proxy.skip(numbers)

    def beat(self) -> None:
        """Send heartbeats, unless messages wait whose numbers are not given yet."""
        with self.lock:
            if not self.holds:
                for proxy in self.outlets.values():
                    proxy.beat()

    def resize(self, depth: int) -> None:
        """Keep as many samples as the publisher does."""
        with self.lock:
            self.depth = depth
            for proxy in self.outlets.values():
                proxy.resize(depth)

    def close(self) -> None:
        """Remove all proxies of the publisher."""
        with self.lock:
            for proxy in self.outlets.values():
                proxy.close()
            self.outlets.clear()
            self.early.clear()


@dataclass(frozen=True, slots=True)
class Relayed(Message):
    """A message of an advanced publisher; interceptors' changed versions of it belong to the same publisher."""

    state: PublisherState | None = field(default=None, compare=False, repr=False)

    def with_payload(self, payload: bytes) -> Message:
        """Return a copy with another payload, of the same publisher."""
        return self.with_(payload=payload)


def relayed(message: Message, state: PublisherState) -> Relayed:
    """Return a message that knows its publisher."""
    return Relayed(
        message.time,
        message.key,
        message.payload,
        message.kind,
        message.encoding,
        message.attachment,
        message.qos,
        message.segment,
        message.sequence,
        message.publish_time,
        state,
    )
