"""Begins a play in the middle of a log with the last earlier messages of latched topics, as for a late joiner."""

from __future__ import annotations

from collections import deque
from itertools import chain
from operator import itemgetter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from riot_bus.log.playback.sources import Source
    from riot_bus.vocabulary.message import Message


class RecallingSource:
    """A source that starts with the last earlier messages of latched topics, if it does not start at the beginning.

    They get the time of the start, and keep their order. To find them, the logs are read up to the start; for a later
    start, only from the previous one on.

    Args:
        source: Source of the messages.
        before: Function that returns the messages of the latched topics from one time until another (exclusive).
        depths: Number of the last messages that are latched, by key.
        origin: Time at which the logs begin, nanoseconds; `source` may begin later.
    """

    def __init__(
        self, source: Source, before: Callable[[int, int], Iterator[Message]], depths: Mapping[str, int], *, origin: int
    ) -> None:
        self._source, self._before, self._depths, self._origin = source, before, depths, origin
        self.start, self.end = source.start, source.end
        # The latched messages at a time, numbered in the logs' order; replaced as a whole, as two threads may use it.
        self._known: tuple[int, int, dict[str, deque[tuple[int, Message]]]] = origin, 0, {}

    def messages(self, start: int | None = None) -> Iterator[Message]:
        """Yield the latched messages, then those of the source."""
        begin = self.start if start is None else max(start, self.start)
        for message in self._recalled(begin):
            yield message.with_(time=begin)
        yield from self._source.messages(start)

    def _recalled(self, begin: int) -> list[Message]:
        if not self._depths or begin <= self._origin:
            return []
        until, number, known = self._known
        if until > begin:
            until, number, known = self._origin, 0, {}
        last = {key: numbered.copy() for key, numbered in known.items()}
        for message in self._before(until, begin):
            number += 1
            last.setdefault(message.key, deque(maxlen=self._depths[message.key])).append((number, message))
        self._known = begin, number, last
        return [message for _, message in sorted(chain.from_iterable(last.values()), key=itemgetter(0))]
