"""Lock-step: the next message goes out when the last one has had its effect.

The inside of a component cannot be seen from here, so what it publishes tells whether it has settled:

* `Quiet`: nothing has come on the watched keys for a while, counted from the message or from the latest arrival.
* `Acknowledged`: something has come on a key since the message went out.

After a deadline, the player continues all the same, and counts this case.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from riot_bus.zenoh.session import canonical, release

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.zenoh import api as zenoh

_LOOK_S = 0.1  # so late may a stop be noticed; an arrival ends the wait at once


class Settling(ABC):
    """Wait for the subscribers to settle after each message, by the messages that come on some keys.

    Attributes:
        unsettled: Number of times that they did not settle within the timeout.
    """

    def __init__(self, session: zenoh.Session, keys: Sequence[str], *, timeout: float) -> None:
        from riot_bus.zenoh import api as zenoh

        self.unsettled = 0
        self._timeout = timeout
        self._bell = threading.Condition()
        self._count = self._before = 0
        self._last = time.monotonic()
        self._subscribers: list[Any] = [
            session.declare_subscriber(key, self._heard, allowed_origin=zenoh.Locality.REMOTE)
            for key in canonical(keys)
        ]

    def sent(self) -> None:
        """Note that a message is about to be published."""
        with self._bell:
            self._before, self._last = self._count, time.monotonic()

    def wait(self, given_up: Callable[[], bool]) -> bool:
        """Return whether they have settled; False after the timeout, or when told to give up."""
        deadline = time.monotonic() + self._timeout
        with self._bell:
            while (left := self._left(now := time.monotonic())) > 0:
                if given_up():
                    return False
                if now >= deadline:
                    self.unsettled += 1
                    return False
                self._bell.wait(min(left, deadline - now, _LOOK_S))
        return True

    def close(self) -> None:
        """Stop watching."""
        release(*self._subscribers)

    @abstractmethod
    def _left(self, now: float) -> float:
        """Return the seconds until the next check; at most 0 if they have settled."""

    def _heard(self, sample: zenoh.Sample) -> None:
        with self._bell:
            self._count += 1
            self._last = time.monotonic()
            self._bell.notify_all()


class Quiet(Settling):
    """Settled when nothing has come on the watched keys for `window` seconds."""

    def __init__(self, session: zenoh.Session, keys: Sequence[str], *, window: float, timeout: float) -> None:
        super().__init__(session, keys, timeout=timeout)
        self._window = window

    def _left(self, now: float) -> float:
        return self._last + self._window - now


class Acknowledged(Settling):
    """Settled when something has come on the watched keys since the message went out."""

    def _left(self, now: float) -> float:
        return 0.0 if self._count > self._before else _LOOK_S
