"""A segment of a router in this process, for bridges, with nothing between them and the interceptors."""

from __future__ import annotations

import logging
import threading
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, TypeAlias

from riot_bus.router.advanced.proxy_publisher import StoreFilter
from riot_bus.vocabulary.message import Qos
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.segment_port import message_of
from riot_bus.zenoh.session import release
from riot_bus_bridges.host.local_ingress import Audience, Inner
from riot_bus_bridges.host.outer_port import put_one_by_one

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.types.port import Take
    from riot_bus.zenoh import api as zenoh
    from riot_bus_bridges.host.local_ingress import IngressKey, InnerNetwork
    from riot_bus_bridges.host.outer_port import OuterPort

_LOG = logging.getLogger(__name__)


class InnerOutlet:
    """Publisher for one key; see `InnerPort.publisher`."""

    def __init__(
        self, audience: Audience, track: IngressKey, *, owns: Callable[[str], bool], speaking: threading.local | None
    ) -> None:
        self.track, self.echo = track, audience.put
        self._audience, self._owns, self._speaking = audience, owns, speaking

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publish; waits for slow receivers if it is reliable."""
        self.track.put(payload, attachment)
        speaking = self._speaking
        if speaking is None:
            self.echo(payload, attachment)
            return
        speaking.now = True
        try:
            self.echo(payload, attachment)
        finally:
            speaking.now = False

    def matched(self) -> bool:
        """Return whether published messages have a receiver elsewhere."""
        return self._owns(self.track.key) or self._audience.listens()

    def close(self) -> None:
        """Remove the publisher."""
        self.track.close()
        self._audience.close()


class InnerPort:
    """A segment as a bridge in the router's own process sees it; it ends with the bus.

    A message on an intercepted key goes to the other segments, and to their listeners in this process, on the thread
    that publishes it, unless an interceptor has to look at it. Otherwise it works like `OuterPort`, which describes
    the arguments of the methods.
    """

    def __init__(self, network: InnerNetwork, segment: str) -> None:
        bus = network.bus
        self._network, self._segment = network, segment
        self._session, self._zid = bus.segment(segment).session, bus.segment(segment).zid
        self.endpoint = redacted(bus.endpoint(segment))
        self._ingress = network.ingress(segment)
        # Recorders of a router with one segment listen on this same session, and so does this port.
        self._speaking = threading.local() if len(bus.sessions) == 1 else None

    def publisher(
        self, key: str, *, reliable: bool, changed: Callable[[], None] | None = None, encoding: str = ""
    ) -> InnerOutlet:
        """Return a new publisher, for one thread at a time."""
        qos = Qos(congestion="block" if reliable else "drop")
        speaking = self._speaking
        audience = Audience(
            self._session, key, qos=qos, encoding=encoding, changed=changed, everywhere=speaking is not None
        )
        return InnerOutlet(
            audience, self._ingress.declare(key, qos, encoding), owns=self._ingress.owns, speaking=speaking
        )

    def put_all(self, outlets: Sequence[Any], payloads: Sequence[bytes], attachment: bytes) -> int:
        """Publish many messages with one attachment; return how many could not be published."""
        if self._speaking is not None:
            return put_one_by_one(outlets, payloads, attachment)
        self._ingress.put_all([outlet.track for outlet in outlets], payloads, attachment)
        failed = 0
        for outlet, payload in zip(outlets, payloads, strict=True):
            try:
                outlet.echo(payload, attachment)
            except Exception:
                failed += 1
        return failed

    def subscribe(self, key: str, take: Callable[[bytes, bytes | None], None]) -> ExitStack:
        """Subscribe to messages of others.

        `take` is called with one message at a time, on the thread that brings it: a thread of Zenoh, of the router, or
        of a publisher on another segment.
        """

        def take_all(messages: list[tuple[bytes, bytes | None]]) -> None:
            for message in messages:
                try:
                    take(*message)
                except Exception:
                    _LOG.exception("a message for %s was lost", key)

        return self.collect(key, take_all)

    def collect(self, expression: str, take: Take) -> ExitStack:
        """Subscribe to messages of others, like `subscribe`, but with several messages at once."""
        from riot_bus.zenoh import api as zenoh

        only_stored, lock, speaking = StoreFilter(self._zid), threading.Lock(), self._speaking

        def give(messages: list[tuple[bytes, bytes | None]]) -> None:
            with lock:
                try:
                    take(messages)
                except Exception:
                    _LOG.exception("messages for %s were lost", expression)

        def receive(sample: zenoh.Sample) -> None:
            if speaking is not None and getattr(speaking, "now", False):
                return  # our own message
            kind: Any = sample.kind  # not `is_delete`: a call for each message costs time
            if int(kind) == 0 and not only_stored(sample):
                give([message_of(sample)])

        handler: Any = library_of(self._session).handlers.Callback(receive, indirect=False)
        pin(self._session, expression)
        subscriber = self._session.declare_subscriber(expression, handler)
        listening = ExitStack()  # undone from the end
        listening.callback(release, subscriber)
        listening.callback(self._network.listen(self._segment, Inner(zenoh.KeyExpr(expression), give)))
        return listening


BridgePort: TypeAlias = "InnerPort | OuterPort"
"""A segment as bridges of links see it: of the router in this process, or of one elsewhere."""
