"""Lock-step: the next message goes out when the last one has had its effect.

The inside of a component cannot be seen from here, so what it publishes tells whether it has settled:

* `Quiet`: nothing has come on the watched keys for a while, counted from the message or from the latest arrival.
* `Acknowledged`: something has come on a key since the message went out.

After a deadline, the player continues all the same, and counts this case.
"""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any, Protocol

from riot_bus.zenoh.session import canonical, release

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.zenoh import api as zenoh

__all__ = ["Acknowledged", "Quiet", "Settling"]

_LOOK_S = 0.1  # so late may a stop be noticed; an arrival ends the wait at once


class Settling(Protocol):
    """A way to wait until the subscribers have settled.

    Attributes:
        unsettled: Number of times that they did not settle within the deadline.
    """

    unsettled: int

    def sent(self) -> None:
        """Note that a message is about to be published."""
        ...

    def wait(self, given_up: Callable[[], bool]) -> bool:
        """Return whether they have settled; False after the deadline, or when told to give up."""
        ...

    def close(self) -> None:
        """Stop watching."""
        ...


class _Watch:
    """Notices messages on some keys."""

    def __init__(self, session: zenoh.Session, keys: Sequence[str], timeout: float) -> None:
        from riot_bus.zenoh import api as zenoh

        self.unsettled = 0
        self._timeout = timeout
        self._bell = threading.Condition()
        self._count = self._before = 0
        self._last = time.monotonic()
        self._subscribers: list[Any] = [
            session.declare_subscriber(key, self._take, allowed_origin=zenoh.Locality.REMOTE) for key in canonical(keys)
        ]

    def sent(self) -> None:
        with self._bell:
            self._before, self._last = self._count, time.monotonic()

    def close(self) -> None:
        release(*self._subscribers)

    def _take(self, sample: zenoh.Sample) -> None:
        with self._bell:
            self._count += 1
            self._last = time.monotonic()
            self._bell.notify_all()

    def _wait(self, settled: Callable[[float], float], given_up: Callable[[], bool]) -> bool:
        """Wait until `settled(now)` is at most 0; larger values are the seconds until the next check."""
        deadline = time.monotonic() + self._timeout
        with self._bell:
            while (left := settled(now := time.monotonic())) > 0:
                if given_up():
                    return False
                if now >= deadline:
                    self.unsettled += 1
                    return False
                self._bell.wait(min(left, deadline - now, _LOOK_S))
        return True


class Quiet(_Watch):
    """Settled when nothing has come on the watched keys for `window` seconds."""

    def __init__(self, session: zenoh.Session, keys: Sequence[str], *, window: float, timeout: float) -> None:
        super().__init__(session, keys, timeout)
        self._window = window

    def wait(self, given_up: Callable[[], bool]) -> bool:
        """Return whether it became quiet."""
        return self._wait(lambda now: self._last + self._window - now, given_up)


class Acknowledged(_Watch):
    """Settled when something has come on a key since the message went out."""

    def __init__(self, session: zenoh.Session, key: str, *, timeout: float) -> None:
        super().__init__(session, [key], timeout)

    def wait(self, given_up: Callable[[], bool]) -> bool:
        """Return whether the acknowledgement came."""
        return self._wait(lambda _: 0.0 if self._count > self._before else _LOOK_S, given_up)
