"""Sources for a player: messages sorted by time, which can be read again from any time, in bounded memory."""

from __future__ import annotations

from heapq import merge
from itertools import takewhile
from operator import attrgetter
from typing import TYPE_CHECKING, Protocol

from riot_bus.pipeline.queue import EmissionQueue
from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from riot_bus.log.reader import LogReader
    from riot_bus.pipeline.runner import Pipeline


class Source(Protocol):
    """Messages sorted by time.

    Attributes:
        start: Beginning of the time line, nanoseconds; the first message may come later.
        end: End of the time line, nanoseconds; no message is later.
    """

    start: int
    end: int

    def messages(self, start: int | None = None) -> Iterator[Message]:
        """Yield the messages sorted by time, those of equal time always in the same order.

        Args:
            start: Earliest time, nanoseconds; None for all.
        """
        ...


class LogSource:
    """The delivered messages of a log, under other keys if wanted.

    Args:
        reader: Reader of the log, open as long as the source is used.
        keys: Key to play as, by recorded key; other keys are left out. None for all keys unchanged.
        shift: Nanoseconds that are added to each message's time.
    """

    def __init__(self, reader: LogReader, keys: Mapping[str, str] | None = None, *, shift: int = 0) -> None:
        self._reader = reader
        self._keys = keys
        self._shift = shift
        low, high = reader.span() or (0, 0)
        self.start, self.end = low + shift, high + shift

    def messages(self, start: int | None = None) -> Iterator[Message]:
        """Yield the messages in the order of `LogReader.messages`."""
        keys, shift = self._keys, self._shift
        low = None if start is None else max(0, start - shift)
        if keys is None and not shift:
            yield from self._reader.messages(start=low)
            return
        for message in self._reader.messages(start=low, topics=None if keys is None else [*keys]):
            key = message.key if keys is None else keys.get(message.key)
            if key is None:
                continue
            if key == message.key and not shift:
                yield message
            else:
                yield Message(
                    message.time + shift,
                    key,
                    message.payload,
                    message.kind,
                    message.encoding,
                    message.attachment,
                    message.qos,
                    message.segment,
                    message.sequence,
                    message.publish_time,
                )


class MergedSource:
    """Several sources on one time line; at equal times, the source that is named first comes first.

    Memory holds what each of the sources holds, and one message of each.

    Args:
        sources: Any number of sources; without one there are no messages.
        start: Time at which to begin, nanoseconds; None for the beginning.
        end: Time at which to end, nanoseconds, exclusive; None for the end.
    """

    def __init__(self, sources: Sequence[Source], *, start: int | None = None, end: int | None = None) -> None:
        self._sources = tuple(sources)
        first = min((source.start for source in sources), default=0)
        last = max((source.end for source in sources), default=0)
        self.start = first if start is None else start
        self.end = max(self.start, last if end is None else min(end, last))
        self._limit = end

    def messages(self, start: int | None = None) -> Iterator[Message]:
        """Yield the messages of all sources between start and end."""
        low = self.start if start is None else max(start, self.start)
        each = [source.messages(low) for source in self._sources]
        merged = each[0] if len(each) == 1 else merge(*each, key=attrgetter("time"))
        limit = self._limit
        yield from merged if limit is None else takewhile(lambda message: message.time < limit, merged)


class PipedSource:
    """A source whose messages pass through the interceptors of a pipeline, in the log's own time.

    Messages are delayed in the log's time, so the actual delay depends on the rate. Messages that are still delayed
    when the player seeks are lost. A message passes through the pipeline shortly before it is due.
    """

    def __init__(self, source: Source, pipeline: Pipeline) -> None:
        self._source = source
        self._pipeline = pipeline
        self.start, self.end = source.start, source.end

    def messages(self, start: int | None = None) -> Iterator[Message]:
        """Yield the resulting messages, sorted by due time."""
        queue = EmissionQueue()
        for message in self._source.messages(start):
            queue.push(*self._pipeline.feed(message).emissions)
            for emission in queue.pop_due(message.time):
                yield emission.message_when_due()
        for emission in queue.pop_due():
            yield emission.message_when_due()
