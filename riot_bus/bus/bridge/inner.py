"""A segment of a router in this process, for bridges: nothing is between them and the interceptors."""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING, Any

from riot_bus.bus.advanced.standin import StoreFilter
from riot_bus.bus.bridge.port import Inlet
from riot_bus.bus.runtime import release
from riot_bus.message import Qos

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh

    from riot_bus.bus.ramp import Ramp
    from riot_bus.bus.router import Bus

__all__ = ["InnerOutlet", "InnerPort"]

_LOG = logging.getLogger(__name__)


class InnerOutlet:
    """Publishes on one key; see `InnerPort.publisher`."""

    def __init__(
        self,
        session: zenoh.Session,
        ramp: Ramp,
        key: str,
        *,
        qos: Qos,
        speaking: threading.local | None,
        changed: Callable[[], None] | None = None,
        encoding: str = "",
    ) -> None:
        import zenoh

        block = qos.congestion == "block"
        self._publisher: Any = session.declare_publisher(
            key,
            encoding=zenoh.Encoding(encoding) if encoding else None,
            congestion_control=zenoh.CongestionControl.BLOCK if block else zenoh.CongestionControl.DROP,
            express=qos.express,
            # Who records a router of one segment listens on this very session.
            allowed_destination=zenoh.Locality.REMOTE if speaking is None else zenoh.Locality.ANY,
        )
        self._declared: list[Any] = [self._publisher]
        if changed is not None:
            handler: Any = zenoh.handlers.Callback(lambda status: changed(), indirect=False)
            self._declared.insert(0, self._publisher.declare_matching_listener(handler))
        self._key, self._ramp = key, ramp
        self._track = ramp.track(key, qos, encoding)
        self._cross, self._put = self._track.put, self._publisher.put
        self._speaking = speaking

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publish; waits for slow receivers if it is reliable."""
        self._cross(payload, attachment)
        speaking = self._speaking
        if speaking is None:
            self._put(payload, attachment=attachment)
            return
        speaking.now = True
        try:
            self._put(payload, attachment=attachment)
        finally:
            speaking.now = False

    def matched(self) -> bool:
        """Return whether somebody elsewhere gets what is published."""
        return self._ramp.owns(self._key) or bool(self._publisher.matching_status.matching)

    def close(self) -> None:
        """Take it away."""
        self._track.close()
        release(*self._declared)


class InnerPort:
    """A segment as a bridge in the router's own process sees it; it ends with the bus.

    What is put on intercepted keys goes to the other segments on the thread that puts it, and there to who listens on
    this thread, too, unless an interceptor has to look at it. Otherwise it is as `SegmentPort`.

    Args:
        bus: The bus, open.
        segment: Name of the segment.
    """

    def __init__(self, bus: Bus, segment: str) -> None:
        self._session = bus.segment(segment).session
        self.endpoint = bus.endpoint(segment)
        self._ramp = bus.ramp(segment)
        self._zid = bus.segment(segment).zid
        self._speaking = threading.local() if len(bus.sessions) == 1 else None

    def publisher(
        self, key: str, *, reliable: bool, changed: Callable[[], None] | None = None, encoding: str = ""
    ) -> InnerOutlet:
        """Return a new publisher.

        Args:
            key: Where to; one thread at a time publishes there.
            reliable: Slow receivers hold it up, instead of losing messages.
            changed: Called on a thread of Zenoh's when `matched` may have changed.
            encoding: Zenoh's encoding string, empty for its default.
        """
        qos = Qos(congestion="block" if reliable else "drop")
        return InnerOutlet(
            self._session, self._ramp, key, qos=qos, speaking=self._speaking, changed=changed, encoding=encoding
        )

    def subscribe(self, key: str, take: Callable[[bytes, bytes | None], None]) -> Inlet:
        """Subscribe to what others put.

        Args:
            key: Where.
            take: Called with payload and attachment, once at a time, on whatever thread brings it: one of Zenoh's, or
                of the router's, or who puts it on another segment.
        """
        import zenoh

        only_stored, lock, speaking = StoreFilter(self._zid), threading.Lock(), self._speaking

        def receive(sample: zenoh.Sample) -> None:
            if speaking is not None and getattr(speaking, "now", False):
                return
            kind: Any = sample.kind
            with lock:
                if only_stored(sample) or int(kind) != 0:
                    return
                attachment = sample.attachment
                try:
                    take(sample.payload.to_bytes(), None if attachment is None else attachment.to_bytes())
                except Exception:
                    _LOG.exception("a message of %s was lost", sample.key_expr)

        handler: Any = zenoh.handlers.Callback(receive, indirect=False)
        return Inlet(self._session.declare_subscriber(key, handler))

    collect = subscribe
