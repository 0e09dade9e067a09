"""Writes messages to a log on a thread of its own, so that a slow disk holds up no other thread."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING

from riot_bus.log.account import Account
from riot_bus.log.recorded_file import RecordedFile, Writer
from riot_bus.log.writing_queue import LostMessagesError
from riot_bus.pipeline.mailbox import Mailbox

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.log.layout import Role
    from riot_bus.pipeline.event import Change
    from riot_bus.vocabulary.message import Message

_LOG = logging.getLogger(__name__)
_TICK_S = 0.25  # a quarter of the second at which the writer ends a chunk
_LINGER_S = 0.005  # at 10,000 messages/s one wake-up for 50; small against a chunk's second
FINISH_S = 60.0  # enough for 128 MiB (the interceptor's default of `capacity_bytes`) at 2.3 MB/s
_HANDFUL = 256  # another file may begin after so many messages


class Recorder:
    """A recording with a queue before it: messages are written by a separate thread; those that do not fit are lost.

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
        self.lossy = False
        """Whether any message is lost."""
        self._topic = topic
        self._mailbox: Mailbox[Callable[[], None]] = Mailbox(capacity=capacity, capacity_bytes=capacity_bytes)
        self._lock = threading.RLock()
        self._file = self._file_of(writer)
        self._former = Account()
        self._files = [self._file]
        self._next: tuple[RecordedFile[Writer], threading.Event] | None = None
        self._done = 0
        self._closing = False
        self._said: set[type[Exception]] = set()
        self._thread = threading.Thread(target=self._run, name="riot-record", daemon=True)
        self._thread.start()

    @property
    def recorded(self) -> Mapping[str, int]:
        """Messages written per topic, without originals."""
        return self.account().recorded

    @property
    def lost(self) -> Counter[str]:
        """Messages per topic that did not fit or could not be written."""
        total: Counter[str] = Counter()
        for topics in self.account().lost.values():
            total.update(topics)
        return total

    @property
    def problem(self) -> str:
        """Why nothing can be written at present; empty as long as all is well."""
        return self._file.writer.problem

    def original(self, message: Message, changes: Sequence[Change]) -> None:
        """Record a message as it was before the interceptors."""
        self._offer(message, "original", changes)

    def delivered(self, message: Message, changes: Sequence[Change] = ()) -> None:
        """Record a message as it was delivered."""
        self._offer(message, "delivered", changes)

    def note(self, name: str, mapping: Mapping[str, str]) -> bool:
        """Write a record that is not a message, in order with the messages; return whether there was room."""

        def write() -> None:
            self._file.attempt(lambda: self._file.writer.note(name, mapping))

        return self._mailbox.offer(write, sum(map(len, mapping.values())))

    def renew(self, key: str) -> None:
        """Write further messages of a key with its type, which has become known."""
        self._file.writer.renew(key)

    def switch(self, writer: Writer, *, patience: float = 5.0) -> None:
        """Continue in another file, each message in exactly one of the two; return when the former one is finished.

        It waits for `patience` seconds until earlier messages are written. If messages arrive faster than they can be
        written, the new writer writes the rest.

        Raises:
            TimeoutError: That took longer; the new writer takes over nevertheless.
        """
        earlier, deadline = self._mailbox.accepted, time.monotonic() + patience
        while self._done < earlier and time.monotonic() < deadline:
            time.sleep(_LINGER_S)
        former, switched = self._file, threading.Event()
        self._next = self._file_of(writer), switched
        self._mailbox.wake()
        finishing = threading.Thread(
            target=self._finish_former, args=(former, switched), name="riot-finish", daemon=True
        )
        finishing.start()
        finishing.join(FINISH_S)
        if finishing.is_alive():
            raise TimeoutError(f"the former file is not finished after {FINISH_S:g} s")

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
        """Return what was recorded so far, in all files, and what was lost and why."""
        with self._lock:
            return Account.total_of([self._former, *(each.account() for each in self._files)])

    def present(self) -> Account:
        """Return what was recorded in the present file, and what was lost and why."""
        return self._file.account()

    def _file_of(self, writer: Writer) -> RecordedFile[Writer]:
        return RecordedFile(writer, topic=self._topic, lock=self._lock, failed=self._failed)

    def _finish_former(self, former: RecordedFile[Writer], switched: threading.Event) -> None:
        switched.wait()
        former.finish()
        with self._lock:
            self._former = Account.total_of([self._former, former.account()])
            self._files.remove(former)

    def _offer(self, message: Message, role: Role, changes: Sequence[Change]) -> None:
        if self._closing:  # the recording has ended
            return
        if not self._mailbox.offer(partial(self._write, message, role, changes), len(message.payload)):
            self._lose(self._file, message, "no room")

    def _lose(self, file: RecordedFile[Writer], message: Message, reason: str) -> None:
        topic = self._topic(message.key)
        with self._lock:
            file.counts.lose(reason, topic)
            self.lossy = True

    def _run(self) -> None:
        ticked = time.monotonic()
        while True:
            self._begin_next()
            jobs = self._mailbox.take_many(_HANDFUL, 0 if self._closing else _TICK_S, linger_s=_LINGER_S)
            for job in jobs:
                job()
                self._done += 1
            if self._closing and not jobs and self.idle():
                self._begin_next()
                self._file.finish()
                return
            now = time.monotonic()
            if now - ticked >= _TICK_S:
                ticked = now
                self._file.attempt(self._file.writer.tick)

    def _begin_next(self) -> None:
        """Write to the next file from now on, if there is one."""
        if self._next is not None:
            (file, switched), self._next = self._next, None
            with self._lock:
                self._file = file
                self._files.append(file)
                self._said.clear()
            switched.set()

    def _write(self, message: Message, role: Role, changes: Sequence[Change]) -> None:
        file = self._file
        writer = file.writer
        refused = writer.refused
        try:
            writer.write(message, role=role, changes=changes)
        except Exception as error:
            file.fail(error)
            self._lose(file, message, "disk" if isinstance(error, LostMessagesError) else "damaged")
            return
        if writer.refused != refused:
            self._lose(file, message, "refused")
        elif role == "delivered":
            file.counts.recorded.add(self._topic(message.key))

    def _failed(self, file: RecordedFile[Writer], error: Exception) -> None:
        lost = isinstance(error, LostMessagesError)
        self.lossy = self.lossy or lost
        if type(error) in self._said:  # a full disk must not flood the diagnostics
            return
        self._said.add(type(error))
        if lost:
            _LOG.error("%s", error)
        else:
            _LOG.error("the recording failed; further failures of this kind are only counted", exc_info=error)
