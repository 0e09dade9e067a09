"""Reads ahead on a thread, so that decompressing a chunk does not make the messages before it late."""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from riot_bus.log.playback.sources import Source
    from riot_bus.vocabulary.message import Message

_BATCH = 64  # messages: one by one, each would take a lock and wake a thread
_BATCH_BYTES = 1 << 20  # as a usual chunk: large messages are handed over after fewer than _BATCH
_BATCHES = 32  # 2048 messages or 32 MiB, of which usual chunks take 1 MiB; not tuned
_WAITING_BYTES = _BATCHES * _BATCH_BYTES
_JOIN_S = 10.0  # threads end at their next batch; a hanging disk must not block for ever


class AheadSource:
    """A source that is read ahead by some 2000 messages or 32 MiB, whichever is less, but by one message at least."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self.start, self.end = source.start, source.end
        self._open: set[_Ahead] = set()

    def messages(self, start: int | None = None) -> Generator[Message, None, None]:
        """Yield the messages; reading ends when the generator is closed."""
        ahead = _Ahead(self._source.messages(start))
        self._open.add(ahead)
        try:
            yield from ahead.messages()
        finally:
            ahead.close()
            self._open = {each for each in self._open if each.thread.is_alive()}

    def close(self) -> None:
        """End all reading; then the logs may be closed."""
        unfinished = tuple(self._open)
        for ahead in unfinished:
            ahead.close()
        for ahead in unfinished:
            ahead.thread.join(_JOIN_S)


class _Ahead:
    def __init__(self, messages: Iterator[Message]) -> None:
        self._messages = messages
        self._bell = threading.Condition()
        self._batches: deque[tuple[list[Message], int]] = deque()
        self._waiting_bytes = 0
        self._closed = self._done = False
        self._error: BaseException | None = None
        self.thread = threading.Thread(target=self._run, name="riot-read-ahead", daemon=True)
        self.thread.start()

    def messages(self) -> Iterator[Message]:
        while True:
            with self._bell:
                self._bell.wait_for(lambda: self._batches or self._done or self._closed)
                if not self._batches:
                    break
                batch, size = self._batches.popleft()
                self._waiting_bytes -= size
                self._bell.notify_all()
            yield from batch
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        with self._bell:
            self._closed = True
            self._batches.clear()
            self._bell.notify_all()

    def _run(self) -> None:
        batch: list[Message] = []
        size = 0
        try:
            for message in self._messages:
                batch.append(message)
                size += len(message.payload)
                if len(batch) >= _BATCH or size >= _BATCH_BYTES:
                    if not self._hand_over(batch, size):
                        return
                    batch, size = [], 0
        except BaseException as error:  # raised by `messages`
            self._error = error
        finally:
            if batch:
                self._hand_over(batch, size)
            with self._bell:
                self._done = True
                self._bell.notify_all()

    def _hand_over(self, batch: list[Message], size: int) -> bool:
        with self._bell:
            self._bell.wait_for(lambda: self._closed or self._room())
            if not self._closed:
                self._batches.append((batch, size))
                self._waiting_bytes += size
                self._bell.notify_all()
            return not self._closed

    def _room(self) -> bool:
        return len(self._batches) < _BATCHES and self._waiting_bytes < _WAITING_BYTES
