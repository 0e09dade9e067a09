"""One queue for all that a process receives, filled in batches.

Zenoh could call Python for each message, but then its receive thread and the main thread fight for the interpreter lock
and throughput drops to a fifth. So each topic has a native channel, and a thread that moves whatever is in it at once.
"""

from __future__ import annotations

from _thread import allocate_lock, start_new_thread
from collections import deque
from time import monotonic

from zenoh import ZError

TYPE_CHECKING = False
if TYPE_CHECKING:
    from _thread import LockType

    from zenoh import Sample, Subscriber
    from zenoh.handlers import Handler

    Batch = tuple[str, list[Sample]]


class Inbox:
    """Unbounded, so that a slow component falls behind instead of losing messages.

    Locks instead of `SimpleQueue.get(timeout=...)`: that one waits for ever, once in a while, when it is woken just
    after its time is up (CPython 3.11).
    """

    CLOSING = 1.0

    def __init__(self) -> None:
        self._batches: deque[Batch] = deque()
        self._bell = allocate_lock()
        self._bell.acquire()
        self._moving: list[LockType] = []

    def add(self, topic: str, subscriber: Subscriber[Handler[Sample]]) -> None:
        """Fill the inbox from a subscriber, until its session closes."""
        moving = allocate_lock()
        moving.acquire()
        self._moving.append(moving)
        start_new_thread(self._move, (topic, [subscriber], moving))

    def next(self, until: float | None) -> Batch | None:
        """Wait for the next batch, at most until a time of the monotonic clock."""
        while not self._batches:
            remaining = -1.0 if until is None else until - monotonic()
            if until is not None and remaining <= 0.0:
                return None
            self._bell.acquire(timeout=remaining)
        return self._batches.popleft()

    def join(self) -> None:
        """Wait for the threads to end, once the session is closed: the interpreter must outlive them."""
        for moving in self._moving:
            moving.acquire(timeout=self.CLOSING)

    def _ring(self) -> None:
        try:
            self._bell.release()
        except RuntimeError:
            return  # it rings already

    def _move(self, topic: str, subscribers: list[Subscriber[Handler[Sample]]], moving: LockType) -> None:
        """Move what one subscriber receives.

        It takes the subscriber out of the list, and lets go of all that is Zenoh's before it says that it has ended:
        Zenoh aborts a process whose interpreter ends meanwhile ("exception not rethrown").
        """
        subscriber = subscribers.pop()
        channel = subscriber.handler
        try:
            while True:
                batch = [channel.recv()]
                while (sample := channel.try_recv()) is not None:
                    batch.append(sample)
                self._batches.append((topic, batch))
                self._ring()
        except ZError:
            pass
        sample = batch = channel = subscriber = None
        moving.release()
