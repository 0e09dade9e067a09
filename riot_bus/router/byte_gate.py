"""Bounds the bytes of large messages that wait in a router: senders wait at a gate, droppable messages are dropped.

Zenoh's channels are bounded in messages, of whatever size. So while large messages come, a forwarder subscribes a
second time, with a callback that moves what is in its channel to a gate, counts it, and waits until there is room.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from riot_bus.zenoh.convert import is_droppable

_BUDGET = 1 << 25  # 32 MiB: floods of 1 MiB cost as much with 16 or 64 MiB (docs/figures.md)
_BUFFER = 1 << 16  # a message that waits keeps a whole receive buffer of Zenoh's, however small it is
_PORTION = 1 << 22  # bytes that are forwarded at once, as copies: four messages of 1 MiB, or 64 small ones
_SOON_S = 0.01  # a portion of small messages in so short a time is a flood of them: see `LARGE`

LARGE = 1 << 16
"""Size above which a message counts; a callback for each smaller one costs throughput (half of it at 32 KiB)."""


class ByteBudget:
    """The bytes that may wait at all gates of a router together.

    A gate may hold as many as are still free. So one alone takes half of them, and there is always room for one more.
    """

    def __init__(self, size: int = _BUDGET) -> None:
        self.changed = threading.Condition()
        self.free = size


class ByteGate:
    """Keeps what came in through a channel until it is forwarded, in order; `drop` gets what there is no room for."""

    def __init__(
        self, budget: ByteBudget, channel: Any, *, closed: type[Exception], drop: Callable[[Any], None]
    ) -> None:
        self.active = False  # set by the forwarder, and unset here in a flood of small messages
        self.waiting: deque[Any] = deque()
        self.held = 0  # bytes that wait or are being forwarded
        self._budget, self._channel, self._closed, self._drop = budget, channel, closed, drop
        self._portion, self._last = 0, 0.0  # bytes being forwarded, since when
        self._receiving = False  # then the forwarder takes the next message itself
        self._ended = False

    def admit(self, sample: Any) -> None:
        """Wait until there is room; called for each message by the thread that has received it."""
        with self._budget.changed:
            if self.active and not self._receiving:
                self._take()
            if not is_droppable(sample):
                self._budget.changed.wait_for(lambda: self._ended or not self.active or not self._full())

    def receive(self) -> list[Any]:
        """Wait for messages and return those to forward next, as those before are forwarded; may raise `closed`."""
        found: list[Any] = []
        largest = 0
        with self._budget.changed:
            self._hold(-self._portion)
            self._portion = 0
            self._take()
            while self.waiting and self._portion < _PORTION:
                found.append(self.waiting.popleft())
                largest = max(largest, len(found[-1].payload))
                self._portion += _weight(found[-1])
            soon, self._last = time.monotonic() - self._last < _SOON_S, time.monotonic()
            if soon and largest <= LARGE and self._portion >= _PORTION:
                found.extend(self.waiting)
                self.waiting.clear()
                self._hold(-self.held)
                self.active, self._portion = False, 0
            self._receiving = not found
            self._budget.changed.notify_all()
        if not found:
            found.append(self._channel.recv())
            self._receiving = False
        return found

    def end(self) -> None:
        """Let senders no longer wait."""
        with self._budget.changed:
            self._ended = True
            self._budget.changed.notify_all()

    def _full(self) -> bool:
        return self.held > 0 and self.held >= self._budget.free

    def _hold(self, size: int) -> None:
        self.held += size
        self._budget.free -= size

    def _take(self) -> None:
        with suppress(self._closed):
            for sample in iter(self._channel.try_recv, None):
                if self._full() and is_droppable(sample):
                    self._drop(sample)
                else:
                    self.waiting.append(sample)
                    self._hold(_weight(sample))


def _weight(sample: Any) -> int:
    return max(len(sample.payload), _BUFFER)
