"""Takes messages that the router's own process puts on a segment through the pipeline to the other segments."""

from __future__ import annotations

import logging
import threading
import time
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.pipeline.runner import AbandonedError
from riot_bus.router.counts import ForwarderCounts, RouteCounts
from riot_bus.router.pipeline_executor import BUDGET_S
from riot_bus.router.worker import Worker
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.convert import publisher_settings
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release, wait_until

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.router.advanced.publisher_proxies import PublisherProxies
    from riot_bus.router.bus import Bus
    from riot_bus.router.delivery_queue import DeliveryQueue
    from riot_bus.types.port import Take
    from riot_bus.vocabulary.message import Qos
    from riot_bus.zenoh import api as zenoh


class Inner(NamedTuple):
    """A bridge in this process that listens.

    Attributes:
        expression: Key expression that it listens to.
        take: Called with payloads and attachments, on any thread; raises nothing.
    """

    expression: zenoh.KeyExpr
    take: Take


class Audience:
    """Publishes on one key to the components of a segment, as long as any of them subscribes.

    Args:
        encoding: Zenoh's encoding string, empty for its default.
        changed: Function called on a thread of Zenoh's when the result of `listens` may have changed.
        everywhere: Whether to publish always, and to this process, too.
        took: Function called with the duration of each publication, in seconds.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        *,
        qos: Qos,
        encoding: str = "",
        changed: Callable[[], None] | None = None,
        everywhere: bool = False,
        took: Callable[[float], None] | None = None,
    ) -> None:
        zenoh = library_of(session)
        pin(session, key)
        self._publisher: Any = session.declare_publisher(
            key,
            encoding=zenoh.Encoding(encoding) if encoding else None,
            allowed_destination=zenoh.Locality.ANY if everywhere else zenoh.Locality.REMOTE,
            **publisher_settings(qos, zenoh),
        )
        self._put = self._publisher.put
        self._changed, self._everywhere, self._took = changed, everywhere, took
        self._listens, self._stale = everywhere, not everywhere
        handler: Any = zenoh.handlers.Callback(self._note, indirect=False)  # indirect: a thread for each handler
        self._listener = self._publisher.declare_matching_listener(handler)

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        """Publish; waits for slow receivers if the QoS says so. Raises zenoh.ZError when the session is closed."""
        if self._stale:
            self._stale = False  # first, so that no change is missed
            self._listens = self.listens()
        if self._listens:
            began = time.monotonic()
            try:
                self._put(payload, attachment=attachment)
            finally:
                if self._took is not None:
                    self._took(time.monotonic() - began)

    def listens(self) -> bool:
        """Return whether there is a subscriber."""
        return bool(self._publisher.matching_status.matching)

    def close(self) -> None:
        """Stop publishing and release the publisher."""
        release(self._listener, self._publisher)

    def _note(self, status: object) -> None:
        self._stale = not self._everywhere
        if self._changed is not None:
            self._changed()


_LOG = logging.getLogger(__name__)


class IngressKey(RouteCounts):
    """One key of a `LocalIngress` (see `declare`); it is used by one thread at a time."""

    def __init__(self, ingress: LocalIngress, key: str, qos: Qos, text: str) -> None:
        super().__init__(key)
        self._ingress = ingress
        self.qos, self.text = qos, text
        self.generation = -1
        self.native = self.inspected = False
        self.rewrite: Callable[[bytes], bytes] | None = None  # all that interceptors do, if that is a function
        self.audiences: dict[str, Audience] = {}
        self.puts: list[Callable[[bytes, bytes | None], None]] = []
        self.takes: tuple[Take, ...] = ()

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        """Send a message to the other segments; waits if too many are queued, or receivers are slow."""
        self._ingress.put_all([self], [payload], attachment)

    def forwarded(self, payload: bytes) -> bytes | None:
        """Return the payload to forward, and count the message; None if an interceptor has to see the message."""
        rewrite = self.rewrite
        if rewrite is not None:
            try:
                payload = rewrite(payload)
            except Exception:  # reported when the interceptor processes the message
                return None
            self.rewritten += 1
        elif self.inspected:
            return None
        else:
            self.passed += not self.native
        return payload

    def close(self) -> None:
        """Stop putting messages of the key; its counts stay."""
        self._ingress.end(self)
        for audience in self.audiences.values():
            audience.close()


class LocalIngress:
    """Takes messages from one segment to the others; keeps the order of the messages of each key.

    Interceptors run on a worker's thread, which is abandoned to them if they block. Messages that pass unchanged or
    with a field set are sent on the thread that puts them, unless earlier ones are still in the queue.

    Args:
        advanced: Proxies of advanced publishers; None if there are no other segments.

    Attributes:
        generation: Number that changes when what is known of keys may have changed.
        queued: Number of messages that interceptors have to see, or whose route is not known yet.
    """

    def __init__(
        self,
        segment: str,
        deliveries: DeliveryQueue,
        advanced: PublisherProxies | None,
        listeners: Mapping[str, tuple[Inner, ...]],
    ) -> None:
        self.segment, self._inner = segment, listeners
        self._targets = deliveries.access.targets[segment]
        self._advanced = advanced
        self.generation = 0
        self.queued = 0
        self._room = threading.Semaphore(4096)  # beyond it, senders wait: more add delay, and their bytes have no limit
        self._deliveries = deliveries
        self._keys: dict[int, IngressKey] = {}
        self._counts = ForwarderCounts(deliveries.executor.rewrote)
        self._changing = threading.Lock()
        self._worker = Worker(f"riot-ingress-{segment}")

    def declare(self, key: str, qos: Qos, encoding: str) -> IngressKey:
        """Return an object that takes messages of a key.

        Args:
            key: Key without wildcards.
        """
        route = IngressKey(self, key, qos, encoding)
        with self._changing:
            self._keys[id(route)] = route
        return route

    def put_all(self, routes: Sequence[IngressKey], payloads: Sequence[bytes], attachment: bytes | None) -> None:
        """Send messages to the other segments; waits if too many are queued, or receivers are slow."""
        # Messages that need no inspection are sent in batches, as far as they have the same listeners.
        going: list[IngressKey] = []
        ready: list[tuple[bytes, bytes | None]] = []
        for route, payload in zip(routes, payloads, strict=True):
            known = route.generation == self.generation and not self.queued
            changed = route.forwarded(payload) if known else None
            if going and (changed is None or (route.takes is not going[0].takes and route.takes != going[0].takes)):
                self._send(going, ready)
                going, ready = [], []
            if changed is None:
                self._enqueue(route, payload, attachment)
            else:
                going.append(route)
                ready.append((changed, attachment))
        if going:
            self._send(going, ready)

    def owns(self, key: str) -> bool:
        """Return whether messages of a key are intercepted; if not, they are routed natively."""
        return bool(self._targets) and self._deliveries.owner(key) is not None

    def forget(self) -> None:
        """Forget what is known of keys, since interceptors, recorder or claims have changed."""
        self.generation += 1

    def idle(self) -> bool:
        """Return whether no message is queued, or being processed from the queue."""
        return not self.queued

    def passed(self) -> Counter[str]:
        """Return how many messages per key passed without inspection; report rewritten ones to the pipeline."""
        with self._changing:
            routes = list(self._keys.values())
        for route in routes:
            self._counts.report(route)
        with self._changing:
            return self._counts.passed(self._keys.values())

    def flows(self) -> Counter[str]:
        """Return how many intercepted messages per key were received."""
        with self._changing:
            return self._counts.received(self._keys.values())

    def end(self, route: IngressKey) -> None:
        """Remove a declared key and keep only its counts."""
        self._counts.report(route)
        with self._changing:
            if self._keys.pop(id(route), None) is not None:
                self._counts.end(route)

    def close(self) -> None:
        """Forward the messages put so far, then end; safe to call twice."""
        self._worker.close()
        self.passed()

    def _send(self, routes: Sequence[IngressKey], messages: list[tuple[bytes, bytes | None]]) -> None:
        """Give messages to the listeners in this process, which all the keys share, then publish them."""
        for take in routes[0].takes:
            take(messages)
        for route, message in zip(routes, messages, strict=True):
            try:
                for put in route.puts:
                    put(*message)
            except Exception as error:
                self._deliveries.not_published(route.key, error)

    def _enqueue(self, route: IngressKey, payload: bytes, attachment: bytes | None) -> None:
        self._room.acquire()
        with self._changing:
            self.queued += 1
        self._worker.do(partial(self._process_queued, route, payload, attachment))

    # -- on the worker's thread ---------------------------------------------------------------------------------------

    def _process_queued(self, route: IngressKey, payload: bytes, attachment: bytes | None) -> None:
        try:
            self._process(route, payload, attachment)
        except AbandonedError:
            raise  # the worker repeats this on another thread
        except Exception:
            _LOG.exception("a message of %s was lost", route.key)
            self._deliveries.lose(route.key, "failure of ours")
        with self._changing:
            self.queued -= 1
        self._room.release()

    def _process(self, route: IngressKey, payload: bytes, attachment: bytes | None) -> None:
        if route.generation != self.generation:
            self._learn(route, payload)
        changed = route.forwarded(payload)
        if changed is not None:
            self._send([route], [(changed, attachment)])
            return
        message = Message(
            time.time_ns(),
            route.key,
            payload,
            encoding=route.text,
            attachment=attachment,
            qos=route.qos,
            segment=self.segment,
            sequence=next(self._deliveries.access.sequence),
        )
        self._deliveries.send(message, self._worker)
        route.seen += 1

    def _learn(self, route: IngressKey, payload: bytes) -> None:
        """Find out how to forward messages of a key."""
        self._counts.report(route)  # interceptors count the messages before this one
        generation, deliveries, key = self.generation, self._deliveries, route.key
        route.native = not self.owns(key)
        route.inspected, route.rewrite = False, None
        targets: tuple[str, ...] = ()
        if not route.native:
            advanced = self._advanced is not None and key in self._advanced.keys
            treatment = deliveries.treatment(key, lambda: payload, advanced=advanced)
            route.inspected, route.rewrite = treatment.inspected, treatment.rewrite
            targets = self._targets
        route.puts = [self._put_function(route, name) for name in targets]
        route.takes = tuple(take for name in targets for take in self._listeners(key, name))
        route.generation = generation

    def _put_function(self, route: IngressKey, name: str) -> Callable[[bytes, bytes | None], None]:
        """Return the function that publishes on another segment."""
        key, access = route.key, self._deliveries.access
        outlet = access.outlets[name]
        if name in self._deliveries.surroundings.observed:
            encoding = outlet.encoding(route.text)
            publisher = outlet.publisher(key, route.qos, encoding)

            def publish(payload: bytes, attachment: bytes | None) -> None:
                began = time.monotonic()
                try:
                    publisher.put(payload, encoding=encoding, attachment=attachment)
                finally:
                    outlet.took(time.monotonic() - began)

            return publish
        if name not in route.audiences:
            route.audiences[name] = Audience(
                access.sessions[name], key, qos=route.qos, encoding=route.text, took=outlet.took
            )
        return route.audiences[name].put

    def _listeners(self, key: str, name: str) -> list[Take]:
        """Return the functions that give messages of a key to listeners in this process."""
        if name in self._deliveries.surroundings.observed:
            return []
        return [each.take for each in self._inner.get(name, ()) if each.expression.includes(key)]


class InnerNetwork:
    """The bridges in a router's own process: local ingresses of a segment call directly who listens to the others."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self._listeners: dict[str, tuple[Inner, ...]] = {}
        self._ingresses: list[LocalIngress] = []
        self._changing = threading.Lock()

    def ingress(self, segment: str) -> LocalIngress:
        """Return the path from a segment to the others; it is closed with the bus."""
        ingress = self.bus.attach(
            lambda deliveries, proxies: LocalIngress(segment, deliveries, proxies, self._listeners)
        )
        self._ingresses.append(ingress)
        return ingress

    def listen(self, segment: str, inner: Inner) -> Callable[[], None]:
        """Call a bridge that listens to a segment directly, until the returned function is called.

        Args:
            inner: The bridge; it also subscribes, to get the messages that come on other ways.
        """

        def change(listeners: Callable[[tuple[Inner, ...]], tuple[Inner, ...]]) -> None:
            with self._changing:
                self._listeners[segment] = listeners(self._listeners.get(segment, ()))
            self.bus.forget()

        def end() -> None:
            # It still gets what was put before, also if ten interceptors block one after the other.
            wait_until(lambda: all(each.idle() for each in self._ingresses), 10 * BUDGET_S)
            change(lambda present: tuple(each for each in present if each is not inner))

        change(lambda present: (*present, inner))
        return end
