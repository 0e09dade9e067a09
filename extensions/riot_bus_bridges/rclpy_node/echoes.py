"""Distinguishes messages that this process has published from those of others on the same topic.

rclpy neither tells the publisher of a message nor lets a subscription ignore its own process. But a message carries its
time of publication, which lies within the call that published it.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_ROUNDED_NS = 1_000  # DDS counts time in fractions of 2**-32 s
_ENDLESS = 1 << 63  # later than any time of publication, which is an int64 of nanoseconds


class Echoes:
    """The messages of one topic that were published here and have not come back yet.

    Args:
        most: Maximum number of remembered messages; a subscription that keeps fewer cannot hold more.
        clock: Clock of the middleware's timestamps, nanoseconds since the Unix epoch.
    """

    def __init__(self, most: int, *, clock: Callable[[], int] = time.time_ns) -> None:
        self.most = most
        self._clock = clock
        self._sent: OrderedDict[int, tuple[int, int, int]] = OrderedDict()
        self._by_content: dict[int, list[int]] = {}
        self._next = 0
        self._lock = threading.Lock()

    def publish(self, payload: bytes, send: Callable[[bytes], None]) -> None:
        """Send a message that may come back, even before `send` returns."""
        with self._lock:
            number = self._next = self._next + 1
            content = hash(payload)
            self._sent[number] = (content, self._clock(), _ENDLESS)
            self._by_content.setdefault(content, []).append(number)
            if len(self._sent) > self.most:
                self._forget(next(iter(self._sent)))
        try:
            send(payload)
        except BaseException:
            with self._lock:
                self._forget(number)
            raise
        end = self._clock()
        with self._lock:
            if number in self._sent:
                self._sent[number] = (*self._sent[number][:2], end)

    def is_echo(self, payload: bytes, published: int) -> bool:
        """Return whether a received message is one of these, and forget it.

        Args:
            payload: Bytes of the message.
            published: Time of publication, 0 if the middleware does not tell it.
        """
        if not self._sent:  # messages are noted before they are sent
            return False
        with self._lock:
            for number in self._by_content.get(hash(payload), ()):
                _, begin, end = self._sent[number]
                if not published or begin - _ROUNDED_NS <= published <= end + _ROUNDED_NS:
                    self._forget(number)
                    return True
        return False

    def _forget(self, number: int) -> None:
        found = self._sent.pop(number, None)
        if found is not None:
            numbers = self._by_content[found[0]]
            numbers.remove(number)
            if not numbers:
                del self._by_content[found[0]]
