"""Faults of timing: messages come later, unevenly, or in another order."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

from riot_bus.interceptors.per_topic import PerTopic
from riot_bus.pipeline.event import Event
from riot_bus.vocabulary.errors import ConfigError


@dataclass
class Delay:
    """Deliver messages later.

    Args:
        seconds: Delay, seconds.
    """

    name: ClassVar[str] = "delay"
    seconds: float

    def __post_init__(self) -> None:
        check_seconds("seconds", self.seconds)

    def message(self, event: Event) -> None:
        """Delay it."""
        event.delay(self.seconds)


@dataclass
class Jitter:
    """Deliver messages unevenly late; the order within a topic is kept.

    Args:
        seconds: Mean delay, seconds.
        spread: Most that a delay differs from the average.
    """

    name: ClassVar[str] = "jitter"
    seconds: float
    spread: float
    _last: PerTopic[int] = field(default_factory=PerTopic, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_seconds("seconds", self.seconds)
        check_seconds("spread", self.spread)

    def message(self, event: Event) -> None:
        """Delay it, but not to before the preceding message."""
        now = due(event)
        wanted = now + int(1e9 * max(0.0, self.seconds + self.spread * (2 * event.draw() - 1)))
        last = self._last.get(event.topic)
        if last is not None:
            # A clock that was set back must not hold up messages until it has caught up.
            wanted = max(wanted, min(last, now + int(1e9 * (self.seconds + self.spread))))
        self._last[event.topic] = wanted
        hold_until(event, wanted)


@dataclass
class Reorder:
    """Deliver messages in another order.

    Args:
        window: Seconds within which messages may overtake each other.
    """

    name: ClassVar[str] = "reorder"
    window: float

    def __post_init__(self) -> None:
        check_seconds("window", self.window)

    def message(self, event: Event) -> None:
        """Delay it by chance."""
        event.delay(self.window * event.draw())


def came(event: Event) -> int:
    """Return when a message arrived, in nanoseconds since the first message."""
    return round(event.seconds * 1e9)


def due(event: Event) -> int:
    """Return when a message is due with its present delay, in nanoseconds since the first message."""
    return came(event) + event.delay_ns


def hold_until(event: Event, when: int) -> None:
    """Delay a message until `when`, to the nanosecond, so that messages due at the same time keep their order."""
    left = when - due(event)
    if left > 0:
        seconds = left / 1e9
        while int(seconds * 1e9) < left:
            seconds = math.nextafter(seconds, math.inf)
        event.delay(seconds)


def check_seconds(option: str, value: float) -> None:
    """Raise ConfigError unless a value is a finite time of 0 or more."""
    if not 0 <= value < float("inf"):
        raise ConfigError(f"{option} = {value} is not a time", hint="give seconds, 0 or more")
