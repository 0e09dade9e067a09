"""Faults of timing: messages come later, unevenly, or in another order."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from riot_bus.errors import ConfigError
from riot_bus.interceptors.per_topic import PerTopic

if TYPE_CHECKING:
    from riot_bus.pipeline.event import Event

__all__ = ["Delay", "Jitter", "Reorder"]

_NEXT_S = 1e-6


@dataclass
class Delay:
    """Deliver messages later.

    Args:
        seconds: How much later.
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
        seconds: How much later on average.
        spread: Most that a delay differs from the average.
    """

    name: ClassVar[str] = "jitter"
    seconds: float
    spread: float
    _due: PerTopic[float] = field(default_factory=PerTopic, init=False, repr=False)

    def __post_init__(self) -> None:
        check_seconds("seconds", self.seconds)
        check_seconds("spread", self.spread)

    def message(self, event: Event) -> None:
        """Delay it, but not less than what came before."""
        wanted = event.seconds + max(0.0, self.seconds + self.spread * (2 * event.draw() - 1))
        due = max(wanted, self._due.get(event.topic, 0.0) + _NEXT_S)
        self._due[event.topic] = due
        event.delay(due - event.seconds)


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


def check_seconds(option: str, value: float) -> None:
    """Raise ConfigError unless a value is a finite time of 0 or more."""
    if not 0 <= value < float("inf"):
        raise ConfigError(f"{option} = {value} is not a time", hint="give seconds, 0 or more")
