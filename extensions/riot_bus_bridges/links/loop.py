"""One thread that waits for many file descriptors and times."""

from __future__ import annotations

import heapq
import itertools
import logging
import os
import select
import threading
import time
from collections.abc import Callable

_LOG = logging.getLogger(__name__)

READ = select.EPOLLIN
WRITE = select.EPOLLOUT
_BROKEN = select.EPOLLHUP | select.EPOLLERR


class Timer:
    """Call that is made later, unless it is cancelled."""

    __slots__ = ("_do",)

    def __init__(self, do: Callable[[], None]) -> None:
        self._do: Callable[[], None] | None = do

    def cancel(self) -> None:
        """Cancel the call."""
        self._do = None

    def fire(self) -> None:
        """Make the call."""
        if self._do is not None:
            self._do()


class Loop:
    """Calls back when there is something to read, room to write, or a time has come.

    All methods but `at_end` may be called on any thread; handlers are called on one thread, and what they raise is
    logged.

    Attributes:
        ident: Identifier of the thread; None before it runs.
    """

    def __init__(self) -> None:
        self.ident: int | None = None
        self._epoll = select.epoll()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._epoll.register(self._wake, READ)
        self._handlers: dict[int, Callable[[int], None]] = {}
        self._timers: list[tuple[float, int, Timer]] = []
        self._numbers = itertools.count()
        self._lock = threading.Lock()
        self._last: list[Callable[[], None]] = []
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="mavlink-links", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread; nothing is called back any more."""
        with self._lock:
            self._ended = True
        os.eventfd_write(self._wake, 1)
        if self._thread.is_alive():
            self._thread.join()

    def close(self) -> None:
        """Close the loop; registered descriptors stay open."""
        self.stop()
        self._epoll.close()
        os.close(self._wake)

    def watch(self, descriptor: int, handler: Callable[[int], None], events: int = READ) -> None:
        """Call back with `READ` or `WRITE` bits from now on; a broken descriptor counts as readable."""
        self._handlers[descriptor] = handler
        self._epoll.register(descriptor, events)

    def change(self, descriptor: int, events: int) -> None:
        """Wait for other events of a descriptor."""
        self._epoll.modify(descriptor, events)

    def forget(self, descriptor: int) -> None:
        """Don't call back any more; to be called before the descriptor is closed."""
        if self._handlers.pop(descriptor, None) is not None:
            self._epoll.unregister(descriptor)

    def later(self, seconds: float, do: Callable[[], None]) -> Timer:
        """Call `do` once, after some seconds."""
        timer = Timer(do)
        with self._lock:
            heapq.heappush(self._timers, (time.monotonic() + seconds, next(self._numbers), timer))
        os.eventfd_write(self._wake, 1)
        return timer

    def at_end(self, do: Callable[[], None]) -> None:
        """Call `do` as soon as the handler that calls this has returned."""
        self._last.append(do)

    def _run(self) -> None:
        self.ident = threading.get_ident()
        while not self._ended:
            for descriptor, events in self._epoll.poll(self._patience()):
                if descriptor == self._wake:
                    os.eventfd_read(self._wake)
                    continue
                handler = self._handlers.get(descriptor)
                if handler is not None:
                    self._call(handler, events | READ if events & _BROKEN else events)
            while (timer := self._due()) is not None:
                self._call(timer.fire)

    def _call(self, handler: Callable[..., None], *args: int) -> None:
        """Call a handler, then what it has passed to `at_end`."""
        try:
            handler(*args)
        except Exception:
            _LOG.exception("a link")
        while self._last:
            try:
                self._last.pop()()
            except Exception:
                _LOG.exception("a link")

    def _patience(self) -> float:
        with self._lock:
            return max(0.0, self._timers[0][0] - time.monotonic()) if self._timers else -1.0

    def _due(self) -> Timer | None:
        with self._lock:
            if self._ended or not self._timers or self._timers[0][0] > time.monotonic():
                return None
            return heapq.heappop(self._timers)[2]
