"""Detection of links that Zenoh closes under load, after which publications succeed but all messages are lost."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from riot_bus.zenoh.session import release
from riot_bus.zenoh.session_config import is_control

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Mapping

    import zenoh


@dataclass(frozen=True, slots=True)
class BrokenLink:
    """A link that broke while it was needed.

    Attributes:
        time: Time in nanoseconds since the Unix epoch.
        reason: Kind of failure: a link between our own routers; a publication of ours that waited too long; or a peer
            that reconnected, so it had not left by itself.
    """

    segment: str
    peer: str
    time: int
    reason: Literal["inner", "stalled", "reconnected"]

    def __str__(self) -> str:
        return f"segment {self.segment}: link to {self.peer} broke ({self.reason})"


class TransportWatch:
    """Watches the links of all segments.

    A component that leaves closes its link as well; that is not a fault and is only counted, in `departures`.

    Args:
        wait_before_close_s: Longest wait of a BLOCK publication before Zenoh closes the link.
        inner: Function that returns the ids of the junction and of the segments that are linked at present.
        ours: Function that returns the ids of sessions that we open and close ourselves.
        longest: Function that returns the longest time that one of our publications into a segment took.
    """

    def __init__(
        self,
        wait_before_close_s: float,
        *,
        inner: Callable[[], Container[str]],
        ours: Callable[[], Container[str]],
        longest: Callable[[str], float],
    ) -> None:
        self.broken: list[BrokenLink] = []
        self.departures = 0
        self._limit_s = 0.8 * wait_before_close_s
        self._inner = inner
        self._ours = ours
        self._longest = longest
        self._gone: dict[tuple[str, str], int] = {}
        self._listeners: list[zenoh.TransportEventsListener[None]] = []
        self._lock = threading.Lock()
        self._closed = False

    def start(self, sessions: Mapping[str, zenoh.Session]) -> None:
        """Listen to the transports of each segment's session."""
        for name, session in sessions.items():
            self._listeners.append(session.info.declare_transport_events_listener(self._callback(name)))

    def stop(self) -> None:
        """Ignore all events from now on."""
        self._closed = True
        release(*self._listeners)
        self._listeners.clear()

    def _callback(self, segment: str) -> Callable[[zenoh.TransportEvent], None]:
        def event(event: zenoh.TransportEvent) -> None:
            kind: Any = event.kind
            self.event(segment, str(event.transport.zid), opened=int(kind) == 0)

        return event

    def event(self, segment: str, peer: str, *, opened: bool) -> None:
        """Process one event."""
        with self._lock:
            if self._closed:
                return
            now = time.time_ns()
            if opened:
                if self._gone.pop((segment, peer), None) is not None:
                    self.departures -= 1
                    self.broken.append(BrokenLink(segment, peer, now, "reconnected"))
            elif peer in self._inner():
                self.broken.append(BrokenLink(segment, peer, now, "inner"))
            elif peer in self._ours() or is_control(peer):
                return
            elif self._longest(segment) >= self._limit_s:
                self.broken.append(BrokenLink(segment, peer, now, "stalled"))
            else:
                self.departures += 1
                self._gone[segment, peer] = now
