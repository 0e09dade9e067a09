"""Faults by which messages get lost."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from riot_bus.interceptors.per_topic import PerTopic
from riot_bus.interceptors.timing import came, due, hold_until
from riot_bus.pipeline.event import Event
from riot_bus.vocabulary.errors import ConfigError


@dataclass
class Drop:
    """Drop messages: all that are selected, every n-th, or some by chance, one by one or in bursts.

    Args:
        every: Drop only every n-th message of a topic.
        chance: Share of messages at which a drop begins.
        burst: Number of messages of the topic that a drop takes.
    """

    name: ClassVar[str] = "drop"
    every: int = 1
    chance: float = 1.0
    burst: int = 1
    _until: PerTopic[int] = field(default_factory=PerTopic, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.every < 1 or self.burst < 1:
            raise ConfigError(f"every = {self.every} and burst = {self.burst} must be 1 or more")
        if not 0 <= self.chance <= 1:
            raise ConfigError(f"chance = {self.chance} is not between 0 and 1")

    def message(self, event: Event) -> None:
        """Drop it, or not."""
        index = event.index
        if index < (self._until.get(event.topic) or 0):
            event.drop()
        elif index % self.every == self.every - 1 and (self.chance >= 1 or event.draw() < self.chance):
            if self.burst > 1:
                self._until[event.topic] = index + self.burst
            event.drop()


@dataclass
class Throttle:
    """Let at most so many messages of each topic pass per second, and drop the rest.

    Args:
        rate: Messages per second.
    """

    name: ClassVar[str] = "throttle"
    rate: float
    _next: PerTopic[tuple[int, int]] = field(default_factory=PerTopic, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not 0 < self.rate < float("inf"):
            raise ConfigError(f"rate = {self.rate} is not above 0", hint="give messages per second")

    def message(self, event: Event) -> None:
        """Drop it if it comes too early."""
        now, period = came(event), int(1e9 / self.rate)
        wanted, passed = self._next.get(event.topic) or (now, -1)
        if event.index == passed:
            return  # the same message on its way to another segment
        if now < wanted <= now + period:  # beyond that, the clock was set back
            event.drop()
            return
        # A message that is a little late does not slow the following ones down.
        late = 0 <= now - wanted < period
        self._next[event.topic] = (wanted if late else now) + period, event.index


@dataclass
class Bandwidth:
    """Send messages as over a slow link: each waits for those before it; what does not fit in the queue is dropped.

    Args:
        bytes_per_second: Speed of the link.
        queue: Most payload bytes that wait.
        shared: Whether all topics share one link; if not, each has its own.
    """

    name: ClassVar[str] = "bandwidth"
    bytes_per_second: float
    queue: int = 1 << 20
    shared: bool = False
    _links: PerTopic[tuple[int, int]] = field(default_factory=PerTopic, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not 0 < self.bytes_per_second < float("inf"):
            raise ConfigError(f"bytes_per_second = {self.bytes_per_second} is not above 0")
        if self.queue < 0:
            raise ConfigError(f"queue = {self.queue} is below 0")

    def message(self, event: Event) -> None:
        """Delay or drop it."""
        link = "" if self.shared else event.topic
        now, start, size = came(event), due(event), len(event.payload)
        free, last = self._links.get(link) or (start, now)
        if last - now > 10**9:  # not overtaking: the clock was set back, and queued messages wait as long as before
            free -= last - now
        waiting = (free - start) * self.bytes_per_second / 1e9
        if waiting > 0 and waiting + size > self.queue:
            event.drop()
            return
        free = max(free, start) + int(1e9 * size / self.bytes_per_second)
        self._links[link] = free, now
        hold_until(event, free)
