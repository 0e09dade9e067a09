"""Handing messages from Zenoh's threads to threads of our own, without ever stalling a link."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.message import Message

__all__ = ["Dispatcher", "Mailbox"]

_LOG = logging.getLogger(__name__)
_OVERHEAD_BYTES = 256
_POLL_S = 0.001
ItemT = TypeVar("ItemT")


class Mailbox(Generic[ItemT]):
    """A bounded queue that refuses rather than blocks.

    Args:
        capacity: Most items.
        capacity_bytes: Most payload bytes.
        patience_s: How long `offer(..., patient=True)` may wait for room: as a native router lets a BLOCK publication
            wait, yet far below the time after which Zenoh closes the link. Once that was in vain, nobody waits until
            the box is half empty again, so that many messages in a row cannot stall the link together.
    """

    def __init__(self, *, capacity: int = 100_000, capacity_bytes: int = 1 << 28, patience_s: float = 1.0) -> None:
        self.accepted = 0
        """Number of items taken in so far."""
        # Not SimpleQueue.get(timeout=...): woken just after its time is up, it waits for ever (CPython 3.11).
        self._items: deque[tuple[ItemT, int] | None] = deque()
        self._bell = threading.Lock()
        self._bell.acquire()
        self._lock = threading.Lock()
        self._count = self._bytes = 0
        self._capacity, self._capacity_bytes = capacity, capacity_bytes
        self._patience_s = patience_s
        self._overrun = False

    def __len__(self) -> int:
        return self._count

    def offer(self, item: ItemT, size: int, *, patient: bool = False) -> bool:
        """Put an item in; return False when there is no room for it.

        Args:
            item: What to queue.
            size: Its payload bytes.
            patient: Wait a little for room.
        """
        size += _OVERHEAD_BYTES
        if self._add(item, size):
            return True
        if not patient or self._overrun:
            return False
        deadline = time.monotonic() + self._patience_s
        while time.monotonic() < deadline:
            time.sleep(_POLL_S)
            if self._add(item, size):
                return True
        self._overrun = True
        return False

    def _add(self, item: ItemT, size: int) -> bool:
        with self._lock:
            if self._count >= self._capacity or (self._count and self._bytes + size > self._capacity_bytes):
                return False
            self._count += 1
            self._bytes += size
            self.accepted += 1
            self._items.append((item, size))
            self._ring()
            return True

    def take(self, timeout: float | None = None) -> ItemT | None:
        """Remove and return the oldest item; None after `timeout` seconds or when `wake` was called."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while not self._items:
            remaining = -1.0 if deadline is None else deadline - time.monotonic()
            if deadline is not None and remaining <= 0.0:
                return None
            self._bell.acquire(timeout=remaining)
        entry = self._items.popleft()
        if entry is None:
            return None
        with self._lock:
            self._count -= 1
            self._bytes -= entry[1]
            if self._overrun and 2 * self._count <= self._capacity and 2 * self._bytes <= self._capacity_bytes:
                self._overrun = False
        return entry[0]

    def wake(self) -> None:
        """Let one `take` return None."""
        self._items.append(None)
        self._ring()

    def _ring(self) -> None:
        with contextlib.suppress(RuntimeError):  # it rings already
            self._bell.release()


class Dispatcher:
    """Calls back with messages on one thread of its own; a slow callback delays others, but never a link.

    Args:
        name: Name of the thread.
        lost: Called with each message for which there was no room.
        mailbox: Other bounds than the default.
    """

    def __init__(
        self,
        name: str,
        lost: Callable[[Message], None],
        *,
        mailbox: Mailbox[tuple[Callable[[Message], None], Message]] | None = None,
    ) -> None:
        self.failures = 0
        """Number of callbacks that raised; each was logged."""
        self._name = name
        self._lost = lost
        self._mailbox = Mailbox() if mailbox is None else mailbox  # an empty one is false
        self._done = 0
        self._closing = False
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()

    def deliver(self, callback: Callable[[Message], None], message: Message) -> None:
        """Queue one call."""
        if not self._mailbox.offer((callback, message), len(message.payload)):
            self._lost(message)

    def start(self) -> None:
        """Start the thread, unless it runs."""
        with self._lock:
            if self._thread is None and not self._closing:
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()

    def idle(self) -> bool:
        """Return whether every queued call was made."""
        return self._done >= self._mailbox.accepted

    def close(self) -> None:
        """Make the queued calls and end; safe to call twice."""
        with self._lock:
            self._closing = True
            thread, self._thread = self._thread, None
        if thread is not None:
            self._mailbox.wake()
            if thread is not threading.current_thread():
                thread.join()

    def _run(self) -> None:
        while True:
            item = self._mailbox.take()
            if item is None:
                return
            try:
                item[0](item[1])
            except Exception:
                self.failures += 1
                _LOG.exception("a callback for %s failed", item[1].key)
            self._done += 1
