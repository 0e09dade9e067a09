"""Queues that pass messages from Zenoh's threads to our own threads without ever stalling a link."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from riot_bus.vocabulary.message import Message

_LOG = logging.getLogger(__name__)
_OVERHEAD_BYTES = 256  # an estimate of a queued item without its payload, so that small ones count, too
_HANDFUL_BYTES = 1 << 22  # items taken no longer count as queued: bounds the memory beyond the capacity
ItemT = TypeVar("ItemT")


class Mailbox(Generic[ItemT]):
    """A bounded queue that rejects items instead of blocking.

    Args:
        capacity: Largest number of items.
        capacity_bytes: Largest total size of payloads, in bytes.
    """

    def __init__(self, *, capacity: int = 100_000, capacity_bytes: int = 1 << 28) -> None:
        self.accepted = 0
        """Number of items taken in so far."""
        # Not SimpleQueue.get(timeout=...): woken just after its time is up, it waits for ever (CPython 3.11).
        self._items: deque[tuple[ItemT, int] | None] = deque()
        self._bell = threading.Lock()
        self._bell.acquire()
        self._lock = threading.Lock()
        self._count = self._bytes = 0
        self._capacity, self._capacity_bytes = capacity, capacity_bytes

    def __len__(self) -> int:
        return self._count

    def offer(self, item: ItemT, size: int) -> bool:
        """Queue an item; return False if there is no room for it."""
        size += _OVERHEAD_BYTES
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
        found = self.take_many(1, timeout)
        return found[0] if found else None

    def take_many(self, most: int, timeout: float | None = None, *, linger_s: float = 0.0) -> list[ItemT]:
        """Remove and return the oldest items; return none after `timeout` seconds or when `wake` was called.

        Args:
            most: Largest number of items; fewer are returned if they are large.
            timeout: Seconds to wait for the first one.
            linger_s: Seconds to wait for more after that wait: otherwise, each new item would wake the taking thread,
                and the two threads would pass the interpreter lock back and forth.
        """
        items = self._items
        if not items:
            if not self._wait(timeout):
                return []
            if linger_s:
                time.sleep(linger_s)
        found: list[ItemT] = []
        size = 0
        while items and len(found) < most and size < _HANDFUL_BYTES:
            entry = items.popleft()
            if entry is None:
                break
            found.append(entry[0])
            size += entry[1]
        with self._lock:
            self._count -= len(found)
            self._bytes -= size
        return found

    def wake(self) -> None:
        """Let one `take` return None, or one `take_many` the items before this call."""
        self._items.append(None)
        self._ring()

    def _wait(self, timeout: float | None) -> bool:
        deadline = None if timeout is None else time.monotonic() + timeout
        while not self._items:
            remaining = -1.0 if deadline is None else deadline - time.monotonic()
            if deadline is not None and remaining <= 0.0:
                return False
            self._bell.acquire(timeout=remaining)
        return True

    def _ring(self) -> None:
        if self._bell.locked():  # else it rings already
            with contextlib.suppress(RuntimeError):  # now it does
                self._bell.release()


class Dispatcher:
    """Calls callbacks with messages on its own thread; a slow callback delays others, but never a link.

    Args:
        lost: Function called with each message for which there was no room.
        mailbox: Mailbox with other bounds than the default.
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
