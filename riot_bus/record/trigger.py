"""Conditions on messages, and monitors, that cause a ring to be written."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from riot_bus.monitors.model import TrialView
from riot_bus.pipeline.runner import MOST_TOPICS
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.monitors.model import Invariant
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.predicate import Predicate


class Trigger:
    """Fires when a message meets a condition, or violates a monitor, and the one before it on that key did not.

    Args:
        conditions: Selectors with predicates, such as `/scan where range_max > 10`.
        monitors: Monitors, asked at each message of their topics and whenever `take` is called.
        clock: Function that returns the time, nanoseconds since the Unix epoch.

    Attributes:
        fired: Value of `time.monotonic` when it fired; None if it has not fired since it was taken last.
        reason: Condition or violation for which it fired.
        unread: Number of times that the fields of a message could not be read.

    Raises:
        ConfigError: A monitor judges whole trials only (`whole_trial`).
    """

    def __init__(
        self,
        conditions: Sequence[str],
        *,
        registry: TypeRegistry,
        monitors: Sequence[Invariant] = (),
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self.fired: float | None = None
        self.reason = ""
        self.unread = 0
        self._registry = registry
        self._conditions: list[tuple[str, str, Predicate]] = []
        for text in conditions:
            selector = parse_selector(text)
            assert selector.where is not None
            self._conditions.append((text, selector.topic, parse_predicate(selector.where)))
        self._held: dict[tuple[str, str], bool] = {}
        for each in monitors:
            if getattr(each, "whole_trial", False):
                text = f"monitor {type(each).__name__} judges whole trials, so it cannot watch a recording"
                raise ConfigError(text, hint="name a file without it")
        self._monitors, self._clock = tuple(monitors), clock
        self._lock = threading.Lock()
        self._violated = [False] * len(self._monitors)
        self._seen = [clock()] * len(self._monitors)  # when the last message of each came

    def for_key(self, key: str) -> Callable[[bytes, str], None] | None:
        """Return a function to call with each message of a key, None if no condition or monitor concerns it."""
        mine = [(text, each) for text, topic, each in self._conditions if self._registry.matches(topic, key)]
        matches = self._registry.matches
        watching = [n for n, each in enumerate(self._monitors) if any(matches(topic, key) for topic in each.topics)]
        if not mine and not watching:
            return None

        def look(payload: bytes, key: str) -> None:
            kind = self._registry.type_of(key, payload=payload)
            for text, predicate in mine:
                try:
                    holds = kind is not None and predicate(lambda path: kind.read(payload, path))
                except PayloadError:
                    holds = False
                    self.unread += 1
                if holds and not self._held.get((text, key)):
                    self._fire(text)
                if len(self._held) >= MOST_TOPICS:  # any client may invent keys; conditions then fire again
                    self._held.clear()
                self._held[text, key] = holds
            for number in watching:
                self._judge(number, Message(self._clock(), key, payload))

        return look

    def _judge(self, number: int, message: Message | None) -> None:
        """Ask a monitor about a message, or about the silence since the last one."""
        with self._lock:
            now = self._clock() if message is None else message.time
            outputs = () if message is None else (message,)
            view = TrialView((), True, 0.0, self._registry, outputs, self._seen[number], now)  # noqa: FBT003
            try:
                found = self._monitors[number].judge(view)
            except PayloadError:
                found = ()
                self.unread += 1
            if message is not None:
                self._seen[number] = now
            if found and not self._violated[number]:
                self._fire(found[0].detail)
            if found or message is not None:
                self._violated[number] = bool(found)

    def _fire(self, reason: str) -> None:
        if self.fired is None:
            self.fired, self.reason = time.monotonic(), reason

    def take(self, after: float) -> str | None:
        """Return why it fired, if that was at least `after` seconds ago, and let it fire again; else None."""
        for number in range(len(self._monitors)):
            self._judge(number, None)
        if self.fired is None or time.monotonic() - self.fired < after:
            return None
        self.fired = None
        return self.reason
