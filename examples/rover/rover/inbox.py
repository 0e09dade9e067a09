"""One queue for all that a process receives, filled in batches.

Zenoh could call Python for each message, but then its receive thread and the main thread fight for the interpreter lock
and throughput drops to a fifth. So each topic has a native channel, and a thread that moves whatever is in it at once.
"""

from __future__ import annotations

from _queue import Empty, SimpleQueue
from _thread import start_new_thread
from time import monotonic

from zenoh import ZError

TYPE_CHECKING = False
if TYPE_CHECKING:
    from zenoh import Sample, Subscriber
    from zenoh.handlers import Handler

    Batch = tuple[str, list[Sample]]


class Inbox:
    """Unbounded, so that a slow component falls behind instead of losing messages."""

    CLOSING = 1.0

    def __init__(self) -> None:
        self._batches: SimpleQueue[Batch] = SimpleQueue()
        self._ended: SimpleQueue[str] = SimpleQueue()
        self._movers = 0

    def add(self, topic: str, subscriber: Subscriber[Handler[Sample]]) -> None:
        """Fill the inbox from a subscriber, until its session closes."""
        self._movers += 1
        start_new_thread(self._move, (topic, subscriber))

    def next(self, until: float | None) -> Batch | None:
        """Wait for the next batch, at most until a time of the monotonic clock."""
        try:
            return self._batches.get(timeout=None if until is None else max(0.0, until - monotonic()))
        except Empty:
            return None

    def join(self) -> None:
        """Wait for the threads to end, once the session is closed: the interpreter must outlive them."""
        while self._movers:
            try:
                self._ended.get(timeout=self.CLOSING)
            except Empty:
                return
            self._movers -= 1

    def _move(self, topic: str, subscriber: Subscriber[Handler[Sample]]) -> None:
        channel = subscriber.handler
        try:
            while True:
                batch = [channel.recv()]
                while (sample := channel.try_recv()) is not None:
                    batch.append(sample)
                self._batches.put((topic, batch))
        except ZError:
            self._ended.put(topic)
