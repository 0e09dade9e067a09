"""Conditions on messages, upon which a ring is written."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from riot_bus.errors import PayloadError
from riot_bus.predicate import parse_predicate
from riot_bus.selector import parse_selector

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.predicate import Predicate
    from riot_bus.types.registry import TypeRegistry

__all__ = ["Trigger"]

_MOST_KEYS = 1 << 16


class Trigger:
    """Fires when a message meets a condition and the one before it on that key did not.

    Args:
        conditions: Selectors with predicates, such as `/scan where range_max > 10`.
        registry: Knows topics and types.

    Attributes:
        fired: When it fired, as of `time.monotonic`, and has not been taken since; None if it has not.
        reason: The condition.
        unread: Messages whose fields could not be read.
    """

    def __init__(self, conditions: Sequence[str], *, registry: TypeRegistry) -> None:
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

    def for_key(self, key: str) -> Callable[[bytes, str], None] | None:
        """Return what is to be told of the messages of a key, None if no condition is about them."""
        mine = [(text, each) for text, topic, each in self._conditions if self._registry.matches(topic, key)]
        if not mine:
            return None

        def look(payload: bytes, key: str) -> None:
            kind = self._registry.type_of(key, payload=payload)
            for text, predicate in mine:
                try:
                    holds = kind is not None and predicate(lambda path: kind.read(payload, path))
                except (PayloadError, TypeError):
                    holds = False
                    self.unread += 1
                if holds and not self._held.get((text, key)) and self.fired is None:
                    self.fired, self.reason = time.monotonic(), text
                if len(self._held) >= _MOST_KEYS:
                    self._held.clear()
                self._held[text, key] = holds

        return look

    def take(self, after: float) -> str | None:
        """Return why it fired, if that was so many seconds ago, and let it fire again; else None."""
        if self.fired is None or time.monotonic() - self.fired < after:
            return None
        self.fired = None
        return self.reason
