"""Writes messages to a log on a thread of its own, so that a slow disk holds up no other thread."""

from __future__ import annotations

import logging
import threading
import time
from collections import defaultdict
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, Protocol

from riot_bus.log.account import LOST, Account
from riot_bus.log.writer import LostMessagesError
from riot_bus.pipeline.mailbox import Mailbox
from riot_bus.pipeline.runner import BoundedCounts

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.log.layout import Role
    from riot_bus.pipeline.event import Change
    from riot_bus.vocabulary.message import Message

_LOG = logging.getLogger(__name__)
_TICK_S = 0.25  # a quarter of the second at which the writer ends a chunk
_LINGER_S = 0.005  # at 10,000 messages/s one wake-up for 50; small against a chunk's second
_HANDFUL = 256  # an urgent switch of writers waits until so many messages are written
_PATIENCE_S = 5.0  # then the new writer writes what is still queued; a guess, not measured


class Writer(Protocol):
    """A writer of messages, such as `riot_bus.log.writer.LogWriter`.

    A LostMessagesError names further messages that are lost; any other error loses only the message at hand.
    """

    @property
    def problem(self) -> str:
        """Why nothing can be written at present; empty if all is well."""
        ...

    @property
    def refused(self) -> int:
        """Number of messages that the log cannot hold."""
        ...

    def write(self, message: Message, *, role: Role = ..., changes: Sequence[Change] = ...) -> None:
        """Write one message."""
        ...

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        """Write a record that is not a message, such as metadata."""
        ...

    def renew(self, key: str) -> None:
        """Write further messages of a key with what is now known of the key."""
        ...

    def tick(self) -> None:
        """Make what was written readable, if it is time."""
        ...

    def flush(self) -> None:
        """Wait until all that was written is in the file, or known to be lost."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...


class _Switch(NamedTuple):
    writer: Writer
    totals: Future[tuple[int, int]]


class Recorder:
    """Writes messages from a queue to a log on a separate thread; counts those that do not fit in `lost`.

    If an intercepted message was changed, delayed, copied or dropped, both the original and what was delivered are
    written, under the same sequence number.
    """

    def __init__(
        self,
        writer: Writer,
        *,
        capacity: int = 200_000,
        capacity_bytes: int = 1 << 28,
        topic: Callable[[str], str] = str,
    ) -> None:
        self.recorded = BoundedCounts()
        """Messages written per topic, without originals."""
        self.lost = BoundedCounts()
        """Messages per topic that did not fit or could not be written."""
        self._reasons: defaultdict[str, BoundedCounts] = defaultdict(BoundedCounts)
        self._former = Account()
        self._writer = writer
        self._topic = topic
        self._mailbox: Mailbox[Callable[[], None]] = Mailbox(capacity=capacity, capacity_bytes=capacity_bytes)
        self._lock = threading.Lock()
        self._done = 0
        self._closing = False
        self._urgent: _Switch | None = None
        self._said: set[type[Exception]] = set()
        self._thread = threading.Thread(target=self._run, name="riot-record", daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str:
        """Why nothing can be written at present; empty as long as all is well."""
        return self._writer.problem

    def original(self, message: Message, changes: Sequence[Change]) -> None:
        """Record a message as it was before the interceptors."""
        self._offer(message, "original", changes)

    def delivered(self, message: Message, changes: Sequence[Change] = ()) -> None:
        """Record a message as it was delivered."""
        self._offer(message, "delivered", changes)

    def note(self, name: str, mapping: Mapping[str, str]) -> bool:
        """Write a record that is not a message, in order with the messages; return whether there was room."""
        job = partial(self._guard, lambda: self._writer.note(name, mapping))
        return self._mailbox.offer(job, sum(map(len, mapping.values())))

    def renew(self, key: str) -> None:
        """Write further messages of a key with its type, which has become known."""
        self._writer.renew(key)

    def totals(self) -> tuple[int, int]:
        """Return how many messages were written so far, without originals, and how many were lost."""
        return sum(self.recorded.copy().values()), sum(self.lost.copy().values())

    def switch(self, writer: Writer, *, patience: float = _PATIENCE_S, timeout: float = 60.0) -> tuple[int, int]:
        """Switch to another writer, so that each message is in exactly one of the two files.

        Args:
            writer: The new writer; the former one is closed.
            patience: Seconds to wait until earlier messages are written. If messages arrive faster than they can be
                written, the new writer writes the rest.
            timeout: Further seconds to wait until the former writer is closed.

        Returns:
            The `totals` of the former writer and all before it.

        Raises:
            TimeoutError: That took longer; the new writer takes over nevertheless.
        """
        switch = _Switch(writer, Future())
        if self._mailbox.offer(partial(self._change, switch), 0):
            with suppress(TimeoutError):
                return switch.totals.result(patience)
        self._urgent = switch
        return switch.totals.result(timeout)

    def idle(self) -> bool:
        """Return whether everything accepted so far was written."""
        return self._done >= self._mailbox.accepted

    def close(self, timeout: float | None = None) -> bool:
        """Write what is queued and finish the file; return whether that was done in time. Safe to call twice."""
        self._closing = True
        self._mailbox.wake()
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def account(self) -> Account:
        """Return what was recorded so far, and what was lost and why."""
        with self._lock:
            reasons = {reason: dict(topics) for reason, topics in self._reasons.items()}
        return Account(self.recorded.copy(), reasons)

    def _finish(self) -> None:
        """Note in the file which messages it lacks, and close it."""
        self._guard(self._writer.flush)
        account = self.account()
        self._guard(lambda: self._writer.note(LOST, account.since(self._former).record()))
        self._former = account
        self._guard(self._writer.close)

    def _offer(self, message: Message, role: Role, changes: Sequence[Change]) -> None:
        if self._closing:  # the recording has ended
            return
        if not self._mailbox.offer(partial(self._write, message, role, changes), len(message.payload)):
            self._count_lost(message, "no room")

    def _count_lost(self, message: Message, reason: str) -> None:
        topic = self._topic(message.key)
        with self._lock:
            self.lost.add(topic)
            self._reasons[reason].add(topic)

    def _run(self) -> None:
        ticked = time.monotonic()
        while True:
            self._hurry()
            jobs = self._mailbox.take_many(_HANDFUL, 0 if self._closing else _TICK_S, linger_s=_LINGER_S)
            for job in jobs:
                job()
                self._done += 1
            if self._closing and not jobs:
                self._finish()
                return
            now = time.monotonic()
            if now - ticked >= _TICK_S:
                ticked = now
                self._guard(self._writer.tick)

    def _hurry(self) -> None:
        """Make a switch of writers that has waited too long in the queue."""
        urgent = self._urgent
        if urgent is not None:
            self._urgent = None
            self._change(urgent)

    def _change(self, switch: _Switch) -> None:
        if switch.totals.done():  # made already, by `_hurry` or from the queue
            return
        self._finish()
        self._writer = switch.writer
        self._said.clear()
        switch.totals.set_result(self.totals())

    def _write(self, message: Message, role: Role, changes: Sequence[Change]) -> None:
        writer = self._writer
        refused = writer.refused
        try:
            writer.write(message, role=role, changes=changes)
        except Exception as error:
            self._failed(error)
            self._count_lost(message, "disk" if isinstance(error, LostMessagesError) else "damaged")
            return
        if writer.refused != refused:
            self._count_lost(message, "refused")
        elif role == "delivered":
            self.recorded.add(self._topic(message.key))

    def _guard(self, action: Callable[[], None]) -> None:
        try:
            action()
        except Exception as error:
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        if isinstance(error, LostMessagesError):
            for reason, lost in error.reasons.items():
                self._take_back(reason, lost)
        if type(error) in self._said:  # a full disk must not flood the diagnostics
            return
        self._said.add(type(error))
        if isinstance(error, LostMessagesError):
            _LOG.error("%s", error)
        else:
            _LOG.error("the recording failed; further failures of this kind are only counted", exc_info=error)

    def _take_back(self, reason: str, lost: Mapping[tuple[str, Role], int]) -> None:
        with self._lock:
            for (key, role), number in lost.items():
                topic = self._topic(key)
                self.lost.add(topic, number)
                self._reasons[reason].add(topic, number)
                if role == "delivered":
                    self.recorded.add(topic, -number)
