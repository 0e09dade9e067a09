"""A lane: the thread that takes the messages of one intercepted key expression from one segment to the others.

This is the hot path of the router: most of its work is reading a sample's attributes and one `put`. Two rules keep it
fast: messages that pass unchanged are not decoded, and messages are fetched in batches, since a full channel of
Zenoh's wakes its sender for each single message that is taken out.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections import Counter, deque
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from riot_bus.pipeline.runner import AbandonedError
from riot_bus.router.arrival import SampleArrival
from riot_bus.router.counts import BoundedCounts
from riot_bus.zenoh.convert import FEW, Converter, is_delete, is_droppable
from riot_bus.zenoh.keyexpr_pins import FrequentKeys, pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.router.delivery_queue import DeliveryQueue
    from riot_bus.vocabulary.message import Qos
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.convert import Outlets

__all__ = ["Forwarder"]

_LOG = logging.getLogger(__name__)
_CHANNEL = 256  # 0.6 ms of traffic at 400,000 messages/s (docs/figures.md); a larger channel may hold more bytes
_SLICE = 1024  # 2.5 ms at 2.5 us each, by which new messages are delayed; fewer are sent in smaller batches
_BACKLOG = 8192  # 20 ms of traffic at 400,000 messages/s; droppable messages beyond it are dropped
_BACKLOG_BYTES = 1 << 26  # 64 MiB for each lane; counts instead of `_BACKLOG` for messages above 8 KiB
_SURPLUS = 64  # `BLOCK` messages beyond the room, until senders wait; also the least room, for large messages
_CACHED_KEYS = 1 << 13  # a route may hold a publisher in each segment; keys may be ever new
_TAKE = attrgetter("key_expr", "priority", "congestion_control", "express", "encoding", "attachment", "payload")
_TURN_S = 0.005  # slow interceptors keep the channel full, which blocks Zenoh's threads, for no longer
_MOST_SENDERS = 64  # for each key: timestamps may carry any id, which must not fill the memory


class _KeyRoute:
    """How messages of one key and QoS are forwarded: ready-made calls, and counts of messages."""

    __slots__ = (
        "advanced",
        "congestion",
        "direct",
        "encoding",
        "express",
        "few",
        "key",
        "looked_at",
        "outlets",
        "passed",
        "priority",
        "publishers",
        "qos",
        "rewrite",
        "rewritten",
        "seen",
        "senders",
        "shared",
        "text",
    )

    def __init__(self, key: str, qos: Qos, sample: Any, outlets: list[Outlets], *, looked_at: bool) -> None:
        self.key = key
        self.qos = qos
        self.priority = sample.priority
        self.congestion = sample.congestion_control
        self.express = sample.express
        self.encoding = sample.encoding
        self.text = str(sample.encoding)
        self.shared = sample.payload.as_shm() is not None
        self.publishers: list[Any] = [outlet.occasional(key, qos, self.text) for outlet in outlets]
        self.outlets = outlets
        self.few = 0
        self.direct: Callable[..., None] | None = None  # replaces `put` if one publisher is enough
        self.looked_at = looked_at
        self.advanced = False  # whether the key has advanced publishers
        self.rewrite: Callable[[bytes], bytes] | None = None  # all that interceptors do, if that is a function
        self.passed = self.seen = self.rewritten = 0
        self.senders: set[str] = set()

    def put(self, payload: Any, **more: Any) -> None:
        if self.few <= FEW:
            self.few += 1
            if self.few > FEW:
                self._keep_publishers()
        for publisher, outlet in zip(self.publishers, self.outlets, strict=True):
            publisher.put(outlet.shared(payload) if self.shared else payload, **more)

    def _keep_publishers(self) -> None:
        self.publishers = [each.publisher(self.key, self.qos, self.text) for each in self.outlets]
        if len(self.publishers) == 1 and not self.shared:
            self.direct = self.publishers[0].put


class Forwarder:
    """Receives on one segment and forwards to the others, through the pipeline if it inspects the messages.

    Order is kept within a lane. A slow receiver of `BLOCK` messages holds up the lane and finally the senders, as in
    a plain router. Droppable messages for which there is no room are dropped and counted.

    Args:
        segment: Name of the segment.
        session: The segment's own session.
        expression: Key expression that is intercepted.
        crossing: Queue that takes messages through the pipeline and delivers them.
        convert: Converter of samples to messages.
        owner: Function that returns which of several overlapping expressions a key belongs to.
    """

    def __init__(
        self,
        segment: str,
        session: zenoh.Session,
        expression: str,
        *,
        crossing: DeliveryQueue,
        convert: Converter,
        owner: Callable[[str], str | None],
    ) -> None:
        library = library_of(session)
        self.segment = segment
        self.expression = expression
        self.waiting = False
        """Whether everything so far was processed."""
        self.received = 0
        self.shed = BoundedCounts()
        """Droppable messages per key for which there was no room."""
        self._crossing = crossing
        self._convert = convert
        self._owner = owner
        self._ways: dict[zenoh.KeyExpr, _KeyRoute | None] = {}
        self._by_qos: dict[tuple[str, Qos], _KeyRoute] = {}
        self._former: deque[dict[tuple[str, Qos], _KeyRoute]] = deque()  # forgotten, but perhaps still counting
        self._passed = BoundedCounts()
        self._seen = BoundedCounts()
        self._senders: dict[str, set[str]] = {}
        self._backlog: deque[zenoh.Sample] = deque()
        self._out: deque[tuple[_KeyRoute, list[bytes | None], dict[str, Any] | None]] = deque()
        self._rewriting: list[_KeyRoute] = []
        self._room = _BACKLOG
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
        self._thread = self._spawn()

    def passed(self) -> Counter[str]:
        """Return how many messages per key were forwarded without inspection."""
        counts = Counter(self._passed)
        for way in self._all_ways():
            if way.passed:
                counts[way.key] += way.passed
        return counts

    def flows(self) -> Counter[str]:
        """Return how many messages per key were received."""
        counts = self.passed() + self._seen.copy() + self.shed.copy()  # they may grow meanwhile
        for way in self._all_ways():
            counts[way.key] += way.seen
        return counts

    def senders(self) -> dict[str, set[str]]:
        """Return the ids in the timestamps of messages, by key; this is a sample of the messages."""
        found = {key: set(zids) for key, zids in self._senders.items()}
        for way in self._all_ways():
            if way.senders:
                found.setdefault(way.key, set()).update(way.senders)
        return found

    def forget(self) -> None:
        """Forget what is cached about keys, since interceptors, recorder or claims have changed."""
        former, self._ways, self._by_qos = self._by_qos, {}, {}
        self._former.append(former)

    def _all_ways(self) -> list[_KeyRoute]:
        return [way for ways in [*self._former, self._by_qos] for way in list(ways.values())]

    def _fold(self) -> None:
        """Add up the counts of forgotten routes, when none of them is in use any more."""
        while self._former:
            for way in self._former.popleft().values():
                self._passed.add(way.key, way.passed)
                self._seen.add(way.key, way.seen)
                if way.senders and (way.key in self._senders or len(self._senders) < _CACHED_KEYS):
                    self._senders.setdefault(way.key, set()).update(way.senders)

    def close(self) -> None:
        """Forward the messages received so far, then end; safe to call twice."""
        release(self._subscriber)
        if self._thread is not threading.current_thread():
            while self._thread.is_alive():  # in turns, since a stuck thread is replaced
                self._thread.join(_TURN_S)
            self.forget()
            self._fold()  # also frees the publishers; a retired lane is kept for its counts

    def idle(self) -> bool:
        """Return whether no message is in process."""
        return self.waiting or not self._thread.is_alive()

    def fence(self) -> Callable[[], bool]:
        """Return a function that tells whether all messages that came in before this call are processed.

        An idle lane may have fetched one message that is not counted yet: call the function twice.
        """
        due = self.received + _CHANNEL + _SLICE  # what is in the channel, and what is being fetched from it
        return lambda: self.idle() or self.received - len(self._backlog) > due

    def take_over(self) -> None:
        """Continue on a new thread, starting with the message on which the current one is stuck."""
        stuck, self._current = self._current, None
        if stuck is not None:
            self._backlog.appendleft(stuck)
        self._generation += 1
        self._thread = self._spawn()

    def _spawn(self) -> threading.Thread:
        name = f"riot-lane-{self.segment}"
        thread = threading.Thread(target=self._run, args=(self._generation,), name=name, daemon=True)
        thread.start()
        return thread

    def _run(self, generation: int) -> None:
        backlog, receive, fill, slice_ = self._backlog, self._channel.recv, self._fill, self._slice
        self.flush()
        while generation == self._generation:
            try:
                if not backlog:
                    self.waiting = True
                    sample = receive()
                    self.waiting = False
                    backlog.append(sample)
                    self.received += 1
                fill()
            except self._zenoh_error:  # the subscriber is closed, and nothing is left in its channel
                if not backlog:
                    self.waiting = True
                    return
            try:
                slice_()
            except AbandonedError:
                return
            except Exception:
                current, self._current = self._current, None
                key = self.expression if current is None else str(current.key_expr)
                _LOG.exception("a message of %s was lost", key)
                self._crossing.lose(key, "failure of ours")
                self.flush()  # publishes earlier messages even if none follow

    def _fill(self) -> None:
        backlog, fetch = self._backlog, self._channel.try_recv
        before = len(backlog)
        backlog.extend(itertools.islice(iter(fetch, None), max(0, min(_SLICE, self._room - before))))
        if len(backlog) >= self._room:
            self._shed()
        self.received += len(backlog) - before

    def _shed(self) -> None:
        """Receive a few more messages than there is room for, and keep only those that must not be dropped."""
        most = self._room + _SURPLUS
        for _ in range(_SLICE):
            if len(self._backlog) >= most or (sample := self._channel.try_recv()) is None:
                return
            if is_droppable(sample):
                key = str(sample.key_expr)
                if self._owner(key) == self.expression:
                    self.shed.add(key)
            else:
                self._backlog.append(sample)

    def _slice(self) -> None:
        if self._former and not self._out:
            self._fold()
        backlog = self._backlog
        first = backlog[0]
        size = len(first.payload)
        self._room = max(_SURPLUS, min(_BACKLOG, _BACKLOG_BYTES // (size + 1)))
        began = time.monotonic()
        take, next_sample, ways, out = _TAKE, backlog.popleft, self._ways, self._out.append
        last: _KeyRoute | None = None  # the route to whose payloads `also` appends
        also = out
        for _ in range(min(len(backlog), _SLICE)):
            sample = next_sample()
            key, priority, congestion, express, encoding, attachment, payload = take(sample)
            try:
                way = ways[key]
            except KeyError:
                way = self._learn(key, sample)
            if way is None:
                continue
            if not (way.express is express and way.priority == priority and way.congestion == congestion):
                way = self._learn(key, sample)
                if way is None:
                    continue
            if not way.looked_at:
                payload = payload.to_bytes()  # one library cannot use objects of another
            else:
                payload = self._rewritten(way, payload.to_bytes()) if way.rewrite is not None else None
            if not payload:
                last = None
                self._look(way, sample)
                if time.monotonic() - began > _TURN_S:
                    break  # interceptors are slow: see what has come in meanwhile
                continue
            if attachment is not None:
                last = None
                text = way.text if way.encoding == encoding else str(encoding)
                out((way, [payload], {"encoding": text, "attachment": attachment.to_bytes()}))
            elif way.encoding == encoding:
                if way is last:
                    also(payload)
                else:
                    payloads = [payload]
                    out((way, payloads, None))
                    last, also = way, payloads.append
            else:
                last = None
                out((way, [payload], {"encoding": str(encoding)}))
        self.flush()
        took = time.monotonic() - began
        for name in self._crossing.targets[self.segment]:
            self._crossing.outlets[name].took(took)
        self._note(first)

    def _note(self, sample: zenoh.Sample) -> None:
        """Note, for some messages only, who sent them and that their key is in use."""
        stamp, key = sample.timestamp, sample.key_expr
        way = self._ways.get(key)
        if way is not None:
            self._frequent.saw(key)
        if stamp is not None and way is not None and len(way.senders) < _MOST_SENDERS:
            way.senders.add(str(stamp.get_id()))

    def _learn(self, key_expr: zenoh.KeyExpr, sample: zenoh.Sample) -> _KeyRoute | None:
        """Return the route of messages of this key and QoS; None if another lane forwards them."""
        if len(self._ways) >= _CACHED_KEYS:
            self.forget()
        ways, by_qos = self._ways, self._by_qos  # if `forget` runs now, outdated routes go to the old ones
        key = str(key_expr)
        if self._owner(key) != self.expression:
            ways[key_expr] = None
            return None
        qos = self._convert.qos(sample)
        way = by_qos.get((key, qos))
        if way is None:
            crossing = self._crossing
            advanced = crossing.advanced is not None and crossing.advanced.concerns(self.segment, key, sample)
            looked_at = crossing.recorder is not None or bool(crossing.gate.pipeline.route(key).stages)
            outlets = [crossing.outlets[name] for name in crossing.targets[self.segment]]
            way = _KeyRoute(key, qos, sample, outlets, looked_at=looked_at or advanced)
            way.advanced = advanced
            if looked_at and not advanced and crossing.recorder is None:
                way.rewrite = crossing.gate.rewriter(key, sample.payload.to_bytes())
            by_qos[key, qos] = way
        ways[key_expr] = way
        return way

    def _rewritten(self, way: _KeyRoute, payload: bytes) -> bytes | None:
        """Return the rewritten payload; None if `_look` has to process the message, as if the payload is empty."""
        assert way.rewrite is not None
        try:
            changed = way.rewrite(payload) if payload else b""
        except Exception:  # reported when the interceptor processes the message
            return None
        if not changed:
            return None
        if not way.rewritten:
            self._rewriting.append(way)
        way.rewritten += 1
        return changed

    def _look(self, way: _KeyRoute, sample: zenoh.Sample) -> None:
        """Process one message that interceptors or the recorder inspect, or one that has no payload."""
        payload: Any = None
        if way.looked_at:
            way.seen += 1
            self._current = sample
            if way.advanced:
                self._crossing.take(sample, self.segment, self)
                self._current = None
                return
            arrival = SampleArrival(sample, way.key, time.time_ns(), self.segment, self._convert.at)
            what = self._crossing.feed(way.key, arrival, self)
            self._current = None
            if what is None:
                return
            payload = None if what is True else what
        if payload is None:
            payload = sample.payload.to_bytes()
        encoding, found = sample.encoding, sample.attachment
        attachment = None if found is None else found.to_bytes()
        if is_delete(sample):
            self._out.append((way, [None], {"attachment": attachment}))
        elif attachment is None and way.encoding == encoding:
            self._out.append((way, [payload], None))
        else:
            self._out.append((way, [payload], {"encoding": str(encoding), "attachment": attachment}))

    def flush(self) -> None:
        """Publish what is ready in one go, so that Zenoh sends it together."""
        out = self._out
        while out:
            way, payloads, more = out.popleft()
            if not way.looked_at:
                way.passed += len(payloads)
            put = way.direct or way.put
            for payload in payloads:
                try:
                    if more is None:
                        put(payload)
                    elif payload is not None:
                        put(payload, **more)
                    else:  # a delete
                        for publisher in way.publishers:
                            publisher.delete(**more)
                except Exception as problem:  # must not stop the other messages
                    self._failed(way.key, problem)
        while self._rewriting:
            way = self._rewriting.pop()
            count, way.rewritten = way.rewritten, 0
            way.seen += count
            try:
                self._crossing.gate.rewrote(way.key, count)
            except Exception:  # the interceptor's fault, which must not end this thread
                _LOG.exception("an interceptor of %s could not count what it did", way.key)

    def _failed(self, key: str, error: Exception) -> None:
        _LOG.warning("a message of %s could not be forwarded: %s", key, error)
        self._crossing.lose(key, "not published")
