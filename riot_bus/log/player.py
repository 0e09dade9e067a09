"""Play messages in their order, at their own pace or as fast as possible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from riot_bus.clock import Clock
    from riot_bus.message import Message

__all__ = ["PlayReport", "play"]

_LOOK_UP_NS = 100_000_000


@dataclass(frozen=True, slots=True)
class PlayReport:
    """How a replay went.

    Attributes:
        count: Messages that were published.
        seconds: Time that it took, by the clock.
        latest: Worst lateness of a message, seconds; 0 when no pace was asked for.
        stopped: Whether it was stopped before the end.
    """

    count: int
    seconds: float
    latest: float
    stopped: bool


def play(
    messages: Iterable[Message],
    publish: Callable[[Message], None],
    *,
    rate: float = 0.0,
    clock: Clock,
    stop: Callable[[], bool] | None = None,
) -> PlayReport:
    """Publish messages in exactly this order.

    Deadlines count from the first message, so lateness does not add up; a message whose time lies before its
    predecessor's is published at once.

    Args:
        messages: A log.
        publish: Called for each message.
        rate: Speed relative to the log's own; 0 is as fast as possible.
        clock: Paces the replay.
        stop: Asked before each message and while waiting.

    Raises:
        ConfigError: The rate is negative or not a number.
    """
    if not 0.0 <= rate < float("inf"):
        raise ConfigError(f"rate {rate} is not a speed", hint="give a number above 0, or 0 for as fast as possible")
    begun = clock.now()
    first: int | None = None
    count = latest = 0
    stopped = False
    for message in messages:
        if first is None:
            first = message.time
        if rate:
            due = begun + int((message.time - first) / rate)
            stopped = _wait(due, clock, stop)
            latest = max(latest, clock.now() - due)
        if stopped or (stop is not None and stop()):
            stopped = True
            break
        publish(message)
        count += 1
    return PlayReport(count, (clock.now() - begun) / 1e9, latest / 1e9, stopped)


def _wait(due: int, clock: Clock, stop: Callable[[], bool] | None) -> bool:
    while (now := clock.now()) < due:
        if stop is not None and stop():
            return True
        clock.sleep_until(due if stop is None else min(due, now + _LOOK_UP_NS))
    return False
