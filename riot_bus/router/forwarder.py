"""Forwards the messages of one intercepted key expression from one segment to the others, on a thread of its own.

This is the hot path of the router: most of its work is reading a sample's attributes and one `put`. Two rules keep it
fast: messages that pass unchanged are not decoded, and messages are fetched in batches, since a full channel of
Zenoh's wakes its sender for each single message that is taken out.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections import deque
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from riot_bus.pipeline.runner import AbandonedError, BoundedCounts
from riot_bus.router.byte_gate import LARGE, ByteGate
from riot_bus.router.counts import ForwarderCounts, RouteCounts
from riot_bus.zenoh.convert import FEW, SampleArrival, is_delete, is_droppable
from riot_bus.zenoh.key_table import KeyTable, KnownKey
from riot_bus.zenoh.keyexpr_pins import FrequentKeys, pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable

    from riot_bus.pipeline.runner import Result
    from riot_bus.router.advanced.publisher_proxies import PublisherProxies
    from riot_bus.router.delivery_queue import DeliveryQueue, Treatment
    from riot_bus.vocabulary.message import Qos
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.convert import Outlets

_LOG = logging.getLogger(__name__)
_CHANNEL = 256  # 0.6 ms of traffic at 400,000 messages/s (docs/figures.md); a larger channel may hold more bytes
_SLICE = 1024  # 2.5 ms at 2.5 us each, by which new messages are delayed; fewer are sent in smaller batches
_BACKLOG = 8192  # 20 ms of traffic at 400,000 messages/s; droppable messages beyond it are dropped
_BACKLOG_BYTES = 1 << 23  # 8 MiB, as `_BACKLOG` of 1 KiB: more, or larger messages, are left to a `ByteGate`
_SURPLUS = 64  # `BLOCK` messages beyond the room, until senders wait
_CACHED_KEYS = 1 << 13  # a route may hold a publisher in each segment; keys may be ever new
_ATTRIBUTES = attrgetter("key_expr", "priority", "congestion_control", "express", "encoding", "attachment", "payload")
_TURN_S = 0.005  # slow interceptors keep the channel full, which blocks Zenoh's threads, for no longer


class _KeyRoute(KnownKey, RouteCounts):
    """How messages of one key and QoS are forwarded: ready-made calls, and counts of messages."""

    def __init__(self, key: str, qos: Qos, sample: Any, outlets: list[Outlets], treatment: Treatment) -> None:
        KnownKey.__init__(self, key, sample)
        RouteCounts.__init__(self, key)
        self.qos = qos
        self.inspected, self.advanced, self.rewrite = treatment
        self.text = str(sample.encoding)
        self.shared = sample.payload.as_shm() is not None
        self.publishers: list[Any] = [outlet.occasional(key, qos, self.text) for outlet in outlets]
        self.outlets = outlets
        self.few = 0
        self.direct: Callable[..., None] | None = None  # replaces `put` if one publisher is enough

    def put(self, payload: Any, **more: Any) -> None:
        if self.few <= FEW:
            self.few += 1
            if self.few > FEW:
                self.publishers = [each.publisher(self.key, self.qos, self.text) for each in self.outlets]
                if len(self.publishers) == 1 and not self.shared:
                    self.direct = self.publishers[0].put
        for publisher, outlet in zip(self.publishers, self.outlets, strict=True):
            publisher.put(outlet.shared(payload) if self.shared else payload, **more)


class Forwarder:
    """Receives on one segment and forwards to the others, through the pipeline if it inspects the messages.

    Order is kept. A slow receiver of `BLOCK` messages holds up the forwarder and finally the senders, as in a plain
    router. Droppable messages for which there is no room are dropped and counted.

    Args:
        advanced: Proxies of advanced publishers; None if there are no other segments.
    """

    def __init__(
        self, segment: str, expression: str, deliveries: DeliveryQueue, advanced: PublisherProxies | None
    ) -> None:
        access = deliveries.access
        self._session = session = access.sessions[segment]
        library = library_of(session)
        self.segment = segment
        self.expression = expression
        self.caught_up = False
        """Whether all samples received so far were processed."""
        self.received = 0
        self.shed = BoundedCounts()
        """Droppable messages per key for which there was no room."""
        self._deliveries, self._advanced = deliveries, advanced
        self._converter = access.converters[segment]
        self._outlets = [access.outlets[name] for name in access.targets[segment]]
        self._keys = KeyTable(self._learn, most=_CACHED_KEYS, forget=self._put_aside)
        self._by_qos: dict[tuple[str, Qos], _KeyRoute] = {}
        self._former: deque[dict[tuple[str, Qos], _KeyRoute]] = deque()  # forgotten, but perhaps still counting
        self._counts = ForwarderCounts(deliveries.executor.rewrote)
        self._backlog: deque[zenoh.Sample] = deque()
        self._out: deque[tuple[_KeyRoute, list[bytes | None], dict[str, Any] | None]] = deque()
        self._rewriting: list[_KeyRoute] = []
        self._current: zenoh.Sample | None = None
        self._generation = 0
        self._zenoh_error = library.ZError
        self._frequent = FrequentKeys(session)
        pin(session, expression)
        self._subscriber = session.declare_subscriber(
            expression,
            library.handlers.FifoChannel(_CHANNEL),
            allowed_origin=library.Locality.REMOTE,  # what we publish ourselves must not come back
        )
        self._channel = self._subscriber.handler  # receiving through the subscriber would lock it against undeclaring
        self._gate = ByteGate(access.budget, self._channel, closed=self._zenoh_error, drop=self._drop)
        self._guards: list[Any] = []  # the subscriber by which senders wait at the gate, if it is active
        self._thread = self._spawn()

    def passed(self) -> Counter[str]:
        """Return how many messages per key were forwarded without inspection."""
        return self._counts.passed(self._all_routes())

    def flows(self) -> Counter[str]:
        """Return how many messages per key were received."""
        return self._counts.received(self._all_routes()) + self.shed.copy()  # it may grow meanwhile

    def senders(self) -> dict[str, set[str]]:
        """Return the ids in the timestamps of messages, by key; this is a sample of the messages."""
        return self._keys.senders()

    def forget(self) -> None:
        """Forget what is cached about keys, since interceptors, recorder or claims have changed."""
        self._keys.forget()

    def _put_aside(self) -> None:
        former, self._by_qos = self._by_qos, {}
        self._former.append(former)

    def _all_routes(self) -> list[_KeyRoute]:
        return [route for routes in [*self._former, self._by_qos] for route in list(routes.values())]

    def _fold(self) -> None:
        """Add up the counts of forgotten routes, when none of them is in use any more."""
        while self._former:
            for route in self._former.popleft().values():
                self._counts.end(route)

    def close(self) -> None:
        """Forward the messages received so far, then end; safe to call twice."""
        self._gate.end()
        release(self._subscriber)
        if self._thread is not threading.current_thread():
            while self._thread.is_alive():  # in turns, since a stuck thread is replaced
                self._thread.join(_TURN_S)
            self.forget()
            self._fold()  # also frees the publishers; a retired forwarder is kept for its counts

    def idle(self) -> bool:
        """Return whether no message is in process."""
        return self.caught_up or not self._thread.is_alive()

    def fence(self) -> Callable[[], bool]:
        """Return a function that tells whether all messages that came in before this call are processed.

        An idle forwarder may have fetched one message that is not counted yet: call the function twice.
        """
        due = self.received + len(self._gate.waiting) + _CHANNEL + _SLICE  # what is in the channel, or being fetched
        return lambda: self.idle() or self.received - len(self._backlog) > due

    def take_over(self) -> None:
        """Continue on a new thread, starting with the message on which the current one is stuck."""
        stuck, self._current = self._current, None
        if stuck is not None:
            self._backlog.appendleft(stuck)
        self._generation += 1
        self._thread = self._spawn()

    def _spawn(self) -> threading.Thread:
        name = f"riot-forward-{self.segment}"
        thread = threading.Thread(target=self._run, args=(self._generation,), name=name, daemon=True)
        thread.start()
        return thread

    def _run(self, generation: int) -> None:
        backlog, receive, fill, slice_, gate = self._backlog, self._channel.recv, self._fill, self._slice, self._gate
        self._flush()
        while generation == self._generation:
            try:
                if not backlog:
                    self.caught_up = not gate.waiting
                    backlog.extend(gate.receive() if gate.active else (receive(),))
                    self.caught_up = False
                    self.received += len(backlog)
                if not gate.active:
                    if self._guards:
                        self._end_gate()
                    fill()
            except self._zenoh_error:  # the subscriber is closed, and nothing is left in its channel
                if not backlog:
                    self.caught_up = True
                    self._end_gate()
                    return
            try:
                slice_()
            except AbandonedError:
                return
            except Exception:
                current, self._current = self._current, None
                key = self.expression if current is None else str(current.key_expr)
                _LOG.exception("a message of %s was lost", key)
                self._deliveries.lose(key, "failure of ours")
                self._flush()  # publishes earlier messages even if none follow

    def _fill(self) -> None:
        backlog, fetch = self._backlog, self._channel.try_recv
        before, size = len(backlog), len(backlog[0].payload)
        if size > LARGE or size * before > _BACKLOG_BYTES:
            self._begin_gate()
            return
        most = min(_SLICE, _BACKLOG - before, _BACKLOG_BYTES // (size + 1))
        backlog.extend(itertools.islice(iter(fetch, None), max(0, most)))
        if len(backlog) >= _BACKLOG:
            self._shed()
        self.received += len(backlog) - before

    def _shed(self) -> None:
        """Receive a few more messages than there is room for, and keep only those that must not be dropped."""
        most = _BACKLOG + _SURPLUS
        for _ in range(_SLICE):
            if len(self._backlog) >= most or (sample := self._channel.try_recv()) is None:
                return
            if is_droppable(sample):
                self._drop(sample)
            else:
                self._backlog.append(sample)

    def _drop(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if self._deliveries.owner(key) == self.expression:
            self.shed.add(key)

    def _begin_gate(self) -> None:
        library, self._gate.active = library_of(self._session), True
        handler = library.handlers.Callback(self._gate.admit, indirect=False)
        origin = library.Locality.REMOTE
        self._guards.append(self._session.declare_subscriber(self.expression, handler, allowed_origin=origin))

    def _end_gate(self) -> None:
        release(*self._guards)
        self._guards.clear()

    def _slice(self) -> None:
        if self._former and not self._out:
            self._fold()
        backlog = self._backlog
        first = backlog[0]
        began = time.monotonic()
        attributes, next_sample, routes, out = _ATTRIBUTES, backlog.popleft, self._keys.known, self._out.append
        last: _KeyRoute | None = None  # the route to whose payloads `also` appends
        also = out
        # Hot loop: names are local, and a message that passes unchanged costs no call of a function of ours.
        for _ in range(min(len(backlog), _SLICE)):
            sample = next_sample()
            key, priority, congestion, express, encoding, attachment, payload = attributes(sample)
            try:
                route = routes[key]
            except KeyError:
                route = self._keys.learn(key, sample)
            if route is None:
                continue
            if not (route.express is express and route.priority == priority and route.congestion == congestion):
                route = self._keys.learn(key, sample)
                if route is None:
                    continue
            if not route.inspected:
                payload = payload.to_bytes()  # one library cannot use objects of another
            else:
                payload = self._rewritten(route, payload.to_bytes()) if route.rewrite is not None else None
            if not payload:
                last = None
                self._process(route, sample)
                if time.monotonic() - began > _TURN_S:
                    break  # interceptors are slow: see what has come in meanwhile
                continue
            if attachment is not None:
                last = None
                text = route.text if route.encoding == encoding else str(encoding)
                out((route, [payload], {"encoding": text, "attachment": attachment.to_bytes()}))
            elif route.encoding == encoding:
                if route is last:
                    also(payload)
                else:
                    payloads = [payload]
                    out((route, payloads, None))
                    last, also = route, payloads.append
            else:
                last = None
                out((route, [payload], {"encoding": str(encoding)}))
        self._flush()
        took = time.monotonic() - began
        for outlet in self._outlets:
            outlet.took(took)
        route = self._keys.known.get(first.key_expr)
        if route is not None:
            self._frequent.saw(first.key_expr)
            self._keys.note_sender(route.key, first)

    def _learn(self, key: str, sample: zenoh.Sample) -> _KeyRoute | None:
        """Return the route of messages of this key and QoS; None if another forwarder has them."""
        by_qos = self._by_qos  # first: see `KeyTable.learn`
        if self._deliveries.owner(key) != self.expression:
            return None
        qos = self._converter.qos(sample)
        route = by_qos.get((key, qos))
        if route is None:
            advanced = self._advanced is not None and self._advanced.concerns(self.segment, key, sample)
            treatment = self._deliveries.treatment(key, sample.payload.to_bytes, advanced=advanced)
            route = by_qos[key, qos] = _KeyRoute(key, qos, sample, self._outlets, treatment)
        return route

    def _rewritten(self, route: _KeyRoute, payload: bytes) -> bytes | None:
        """Return the rewritten payload; None if the pipeline has to process the message, as if the payload is empty."""
        assert route.rewrite is not None
        try:
            changed = route.rewrite(payload) if payload else b""
        except Exception:  # reported when the interceptor processes the message
            return None
        if not changed:
            return None
        if route.rewritten == route.reported:
            self._rewriting.append(route)
        route.rewritten += 1
        return changed

    def _process(self, route: _KeyRoute, sample: zenoh.Sample) -> None:
        """Forward one message that interceptors or the recorder inspect, or one that has no payload."""
        payload: Any = None
        if route.inspected:
            route.seen += 1
            self._current = sample
            if route.advanced:
                self._process_advanced(sample)
                self._current = None
                return
            arrival = SampleArrival(sample, route.key, time.time_ns(), self._converter)
            answer = self._deliveries.feed(route.key, arrival, self)
            if answer.result is not None:
                self._deliver(answer.result)
            self._current = None
            if answer.result is not None:
                return
            payload = answer.payload
        if payload is None:
            payload = sample.payload.to_bytes()
        encoding, found = sample.encoding, sample.attachment
        attachment = None if found is None else found.to_bytes()
        if is_delete(sample):
            self._out.append((route, [None], {"attachment": attachment}))
        elif attachment is None and route.encoding == encoding:
            self._out.append((route, [payload], None))
        else:
            self._out.append((route, [payload], {"encoding": str(encoding), "attachment": attachment}))

    def _process_advanced(self, sample: zenoh.Sample) -> None:
        """Deliver a message of an advanced publisher."""
        advanced = self._advanced
        assert advanced is not None
        message = advanced.take(self.segment, sample)
        if message is not None:
            try:
                self._deliver(self._deliveries.result(message, self))
            finally:
                advanced.through(message)

    def _deliver(self, result: Result) -> None:
        self._flush()  # keeps the order of messages
        self._deliveries.deliver(result)

    def _flush(self) -> None:
        """Publish what is ready in one go, so that Zenoh sends it together."""
        out = self._out
        while out:
            route, payloads, more = out.popleft()
            if not route.inspected:
                route.passed += len(payloads)
            put = route.direct or route.put
            for payload in payloads:
                try:
                    if more is None:
                        put(payload)
                    elif payload is not None:
                        put(payload, **more)
                    else:  # a delete
                        for publisher in route.publishers:
                            publisher.delete(**more)
                except Exception as error:  # must not stop the other messages
                    self._deliveries.not_published(route.key, error)
        while self._rewriting:
            self._counts.report(self._rewriting.pop())
