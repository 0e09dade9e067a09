"""A file of a recording while it is written, with the account of what it holds and lacks: for all recorders."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from riot_bus.log.account import LOST, LossCounts
from riot_bus.log.writing_queue import LostMessagesError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.log.account import Account
    from riot_bus.log.layout import Role
    from riot_bus.pipeline.event import Change
    from riot_bus.vocabulary.message import Message


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


WriterT = TypeVar("WriterT", bound=Writer)


class RecordedFile(Generic[WriterT]):
    """A file that is being written.

    Args:
        writer: Writer of the file; closed by `finish`.
        topic: Function that returns the topic of a key.
        lock: Lock under which the counts are changed; a caller that holds it must be able to take it again.
        failed: Function called with this object and each error, after the losses that the error names are counted.
    """

    def __init__(
        self,
        writer: WriterT,
        *,
        topic: Callable[[str], str],
        lock: threading.RLock,
        failed: Callable[[RecordedFile[WriterT], Exception], None],
    ) -> None:
        self.writer = writer
        self.counts = LossCounts()
        self._topic, self._lock, self._failed = topic, lock, failed

    def attempt(self, action: Callable[[], object]) -> None:
        """Do something with the writer; what fails is counted and reported, and never raised."""
        try:
            action()
        except Exception as error:
            self.fail(error)

    def fail(self, error: Exception) -> None:
        """Count the losses that an error of the writer names, and report it."""
        if isinstance(error, LostMessagesError):
            with self._lock:
                for reason, lost in error.reasons.items():
                    for (key, role), number in lost.items():
                        self.counts.lose(reason, self._topic(key), number, written=role == "delivered")
        self._failed(self, error)

    def account(self) -> Account:
        """Return the counts so far."""
        with self._lock:
            return self.counts.account()

    def note_account(self) -> None:
        """Write down which messages the file lacks."""
        account = self.account()
        self.attempt(lambda: self.writer.note(LOST, account.record()))

    def finish(self) -> None:
        """Wait for what is on its way, write down what the file lacks, and close it."""
        self.attempt(self.writer.flush)
        self.note_account()
        self.attempt(self.writer.close)
