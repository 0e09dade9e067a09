"""Does what is asked of a file, at once or on a thread of its own, and tells what is lost when the disk fails."""

from __future__ import annotations

from collections import Counter, deque
from concurrent.futures import Future, ThreadPoolExecutor, wait
from time import monotonic
from typing import TYPE_CHECKING, Any, Self

from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.log.layout import Role

MOST_PENDING = 4  # chunks, by default of 1 MiB: bounds the memory where `most_bytes` does not


class LostMessagesError(EnvironmentFaultError):
    """Messages are lost since the disk is full, slow or has failed; later ones may be written again.

    Attributes:
        reasons: Number of messages missing in the file, by reason (`disk`, `too slow`), key and role.
        errno: Error number of the operating system, None if it reported no error.
    """

    def __init__(
        self,
        reason: str,
        *,
        where: str,
        lost: Counter[tuple[str, Role]],
        errno: int | None = None,
        slow: bool = False,
    ) -> None:
        hint = "record less, or to a faster disk" if slow else "make room"
        super().__init__(f"the log cannot be written: {reason}", where=where, hint=hint)
        self.reasons = {"too slow" if slow else "disk": lost}
        self.errno = errno

    @property
    def lost(self) -> Counter[tuple[str, Role]]:
        """Number of messages lost for any reason, by key and role."""
        return sum(self.reasons.values(), Counter())

    def add(self, other: LostMessagesError) -> None:
        """Add the losses of another error to this one."""
        for reason, lost in other.reasons.items():
            self.reasons[reason] = self.reasons.get(reason, Counter()) + lost


class Attempts:
    """A context in which steps are carried out though earlier ones failed; at its end, their losses are raised."""

    def __init__(self) -> None:
        self._failures: list[LostMessagesError] = []

    def __call__(self, step: Callable[..., object], *arguments: Any) -> None:
        """Carry out a step, and keep what it raises."""
        try:
            step(*arguments)
        except LostMessagesError as error:
            self.add(error)

    def add(self, error: LostMessagesError) -> None:
        """Keep an error."""
        self._failures.append(error)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if self._failures and error is None:
            *earlier, last = self._failures
            for each in earlier:
                last.add(each)
            raise last


class WritingQueue:
    """What is to be done with a file, one after the other; all methods but `failure` are for one thread at a time.

    Args:
        where: Path of the file, for errors.
        threaded: Whether actions run on a separate thread; their errors are then raised by a later call.
        most_bytes: Bytes that may wait for that thread; None for any number.
        patience: Seconds to wait for room. After a wait in vain, no call waits until the queue is at most half full, so
            that many chunks in a row cannot stall the caller together.

    Attributes:
        waiting: Bytes that wait to be written.
        problem: Reason why nothing can be written at present; empty as long as all is well.
        errno: Number of that error, None if the operating system has none.
    """

    def __init__(self, where: str, *, threaded: bool, most_bytes: int | None, patience: float) -> None:
        self.waiting = 0
        self.problem = ""
        self.errno: int | None = None
        self._where, self._most, self._patience, self._overrun = where, most_bytes, patience, False
        self._pending: deque[tuple[Future[None], int]] = deque()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="riot-write") if threaded else None
        self._syncer = ThreadPoolExecutor(1, thread_name_prefix="riot-sync") if threaded else None
        self._syncing: Future[None] | None = None

    def do(self, size: int, action: Callable[..., None], *arguments: Any) -> None:
        """Run an action on the file, now or on the writing thread; `size` is what it takes in memory until then."""
        if self._thread is None:
            try:
                action(*arguments)
            except OSError as error:
                raise self.failure(error, Counter()) from error
        else:
            self._pending.append((self._thread.submit(action, *arguments), size))
            self.waiting += size
            self.collect(MOST_PENDING if self._most is None else 0)

    def has_room(self, size: int, attempt: Attempts, *, patient: bool) -> bool:
        """Return whether so many bytes may wait, too; wait for room where that helps."""
        if self._thread is None or self._most is None:
            return True
        deadline = monotonic() + self._patience
        attempt(self.collect, 0)
        if 2 * self.waiting <= self._most:
            self._overrun = False
        while self._pending and self.waiting + size > self._most:
            left = deadline - monotonic()
            if not patient or self._overrun or left <= 0.0:
                self._overrun = True
                return False
            wait([self._pending[0][0]], timeout=left)
            attempt(self.collect, 0)
        return True

    def collect(self, most: int | None) -> None:
        """Collect finished actions; wait until at most `most` are pending (None: until none is; 0: do not wait)."""
        with Attempts() as attempt:
            if self._syncing is not None and self._syncing.done():
                self.collect_sync(attempt)
            while self._pending and (most is None or self._pending[0][0].done() or 0 < most < len(self._pending)):
                future, size = self._pending[0]
                error = future.exception()
                self._pending.popleft()
                self.waiting -= size
                if isinstance(error, OSError):
                    error = self.failure(error, Counter())
                if isinstance(error, LostMessagesError):
                    attempt.add(error)
                elif error is not None:
                    raise error

    def sync(self, action: Callable[[], None]) -> None:
        """Force written data to the disk, on a thread of its own if there is one, so that chunks need not wait."""
        if self._syncer is None:
            self.synchronise(action)
        elif self._syncing is None:
            self._syncing = self._syncer.submit(self.synchronise, action)

    def synchronise(self, action: Callable[[], None]) -> None:
        """Force written data to the disk now; what was written may be there even if that fails."""
        try:
            action()
        except OSError as error:
            raise self.failure(error, Counter()) from error

    def collect_sync(self, attempt: Attempts) -> None:
        """Wait until the data that are being forced to the disk are there."""
        if self._syncing is not None:
            syncing, self._syncing = self._syncing, None
            attempt(syncing.result)

    def close(self) -> None:
        """End the threads."""
        for thread in (self._thread, self._syncer):
            if thread is not None:
                thread.shutdown()

    def failure(
        self, error: OSError | str, lost: Counter[tuple[str, Role]], *, slow: bool = False
    ) -> LostMessagesError:
        """Return the error to raise, and remember it as the present problem."""
        reason = error if isinstance(error, str) else error.strerror or str(error)
        self.errno = None if isinstance(error, str) else error.errno
        failure = LostMessagesError(reason, where=self._where, lost=lost, errno=self.errno, slow=slow)
        self.problem = failure.message
        return failure
