"""Latched topics where a play begins in the middle: first comes what a late joiner of the recording would have got."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import chain
from operator import itemgetter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from riot_bus.log.playback.sources import Source
    from riot_bus.vocabulary.message import Message

__all__ = ["RecallingSource"]


class RecallingSource:
    """A source that begins with the last messages of latched topics from before, if it does not begin at the beginning.

    They get the time at which it begins, and keep their order. To find them, the logs are read up to there; when it
    begins anew later on, from the time before.

    Args:
        source: The messages.
        before: Returns the messages of the latched topics from one time until another (exclusive).
        depths: How many of the last messages of a key are latched.
        origin: Where the logs begin, nanoseconds; `source` may begin later.
    """

    def __init__(
        self, source: Source, before: Callable[[int, int], Iterator[Message]], depths: Mapping[str, int], *, origin: int
    ) -> None:
        self._source, self._before, self._depths, self._origin = source, before, depths, origin
        self.start, self.end = source.start, source.end
        self._known = _Known(origin, 0, {})  # in one piece: two threads may look at once

    def messages(self, start: int | None = None) -> Iterator[Message]:
        """Yield what is latched, then the messages."""
        begin = self.start if start is None else max(start, self.start)
        for message in self._recalled(begin):
            yield message.with_(time=begin)
        yield from self._source.messages(start)

    def _recalled(self, begin: int) -> list[Message]:
        if not self._depths or begin <= self._origin:
            return []
        known = self._known
        if known.until > begin:
            known = _Known(self._origin, 0, {})
        number, last = known.number, {key: numbered.copy() for key, numbered in known.last.items()}
        for message in self._before(known.until, begin):
            number += 1
            last.setdefault(message.key, deque(maxlen=self._depths[message.key])).append((number, message))
        self._known = _Known(begin, number, last)
        return [message for _, message in sorted(chain.from_iterable(last.values()), key=itemgetter(0))]


@dataclass(frozen=True, slots=True)
class _Known:
    """What is latched at a time; messages are numbered in the logs' order."""

    until: int
    number: int
    last: dict[str, deque[tuple[int, Message]]]
