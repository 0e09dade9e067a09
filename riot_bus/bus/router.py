"""The bus: isolated segments, a junction between them, and interceptors in place of what the junction cuts."""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from riot_bus.bus.client import Subscription, subscribe
from riot_bus.bus.config import WAIT_BEFORE_CLOSE_S
from riot_bus.bus.convert import Claims, Converter, Outlets
from riot_bus.bus.forward import Forwarder
from riot_bus.bus.junction import Junction
from riot_bus.bus.mailbox import Dispatcher, Mailbox
from riot_bus.bus.runtime import canonical, prepare_runtime, release, wait_until
from riot_bus.bus.segments import Segment
from riot_bus.bus.watch import BrokenLink, TransportWatch
from riot_bus.errors import ConfigError, did_you_mean
from riot_bus.message import Qos
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import zenoh

    from riot_bus.bus.recorder import Recorder
    from riot_bus.message import Message

__all__ = ["Bus", "BusPublisher", "Losses", "TopicCounts"]

_LOG = logging.getLogger(__name__)
_SETTLE_S = 0.5
_MATCHING_INTERVAL_S = 0.002
_QUIET_POLLS = 3


@dataclass(slots=True)
class TopicCounts:
    """What happened to one topic; `recorded` includes what was only observed."""

    seen: int = 0
    changed: int = 0
    dropped: int = 0
    added: int = 0
    delivered: int = 0
    recorded: int = 0
    lost: int = 0


@dataclass(frozen=True, slots=True)
class Losses:
    """What was lost against everybody's will; false when nothing was."""

    messages: dict[str, int] = field(default_factory=dict)
    recordings: dict[str, int] = field(default_factory=dict)
    links: tuple[BrokenLink, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.messages or self.recordings or self.links)


class BusPublisher:
    """A publisher that was declared ahead; publishes on a segment as a component there would."""

    def __init__(self, bus: Bus, segment: str, key: str, qos: Qos) -> None:
        self._bus, self._segment, self._key, self._qos = bus, segment, key, qos

    def put(self, payload: bytes, *, encoding: str = "", attachment: bytes | None = None) -> None:
        """Publish a payload."""
        from riot_bus.message import Message

        self._bus.put(
            self._segment, Message(0, self._key, payload, encoding=encoding, attachment=attachment, qos=self._qos)
        )


class Bus:
    """Segments, their junction and the interception between them; a context manager.

    Several may live in one process.

    Args:
        segments: Endpoints to listen on by segment name; no endpoints means a free port of this machine.
        intercept: Key expressions that go through the pipeline instead of the junction.
        pipeline: Interceptors; without one, intercepted messages pass unchanged. Closed by its owner.
        registry: Names topics in counts.
        recorder: Records intercepted messages and `record`. Closed by its owner, after the bus.
        record: Key expressions that are recorded as they pass, although they are not intercepted.
        wait_before_close_s: How long a BLOCK publication may wait for a slow receiver before its link is closed.
        config: Further Zenoh configuration of every segment.
        capacity: Most intercepted messages that wait for the pipeline.
        timeout: Seconds within which everything must be up.
    """

    def __init__(
        self,
        segments: Mapping[str, Sequence[str]],
        *,
        intercept: Sequence[str] = (),
        pipeline: Pipeline | None = None,
        registry: TypeRegistry | None = None,
        recorder: Recorder | None = None,
        record: Sequence[str] = (),
        wait_before_close_s: float = WAIT_BEFORE_CLOSE_S,
        config: Mapping[str, Any] | None = None,
        capacity: int = 100_000,
        timeout: float = 10.0,
    ) -> None:
        if not segments:
            raise ConfigError("a bus needs at least one segment", hint="such as unit=tcp/127.0.0.1:7447")
        self._names = {name: list(listen) for name, listen in segments.items()}
        self._registry = registry or TypeRegistry()
        self._pipeline = pipeline or Pipeline((), registry=self._registry)
        self._recorder = recorder
        self._wait_before_close_s = wait_before_close_s
        self._config = dict(config or {})
        self._timeout = timeout
        self._sequence = itertools.count(1)
        self._lost: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._segments: dict[str, Segment] = {}
        self._outlets: dict[str, Outlets] = {}
        self._converters = {name: Converter(name, self._sequence) for name in segments}
        self._others = {name: [other for other in segments if other != name] for name in segments}
        self._junction: Junction | None = None
        self._cuts: dict[str, list[Subscription]] = {}
        self._observers: list[Subscription] = []
        self._claims = Claims(canonical(intercept))
        self._record = Claims(canonical(record))
        self._mailbox: Mailbox[Message] = Mailbox(capacity=capacity)
        self._forwarder = Forwarder(
            self._mailbox,
            self._pipeline,
            publish=self._forward,
            recorder=recorder,
            sequence=self._sequence,
            lost=self._count_lost,
        )
        self._dispatcher = Dispatcher("riot-observe", self._count_lost)
        self._watch: TransportWatch | None = None
        self._stack = ExitStack()

    # -- life ---------------------------------------------------------------------------------------------------------

    def open(self) -> Self:
        """Open everything; return once routes are up.

        Raises:
            ConfigError: Zenoh refuses a configuration.
            EnvironmentFaultError: A port is in use, or the machine is too slow.
        """
        prepare_runtime(len(self._names))
        with ExitStack() as stack:
            for name, listen in self._names.items():
                segment = Segment(name, listen, config=self._config, wait_before_close_s=self._wait_before_close_s)
                stack.callback(segment.close)
                self._segments[name] = segment
                self._outlets[name] = Outlets(segment.session)
            if len(self._segments) > 1:
                self._junction = Junction(
                    list(self._segments.values()),
                    wait_before_close_s=self._wait_before_close_s,
                    timeout=self._timeout,
                )
                stack.callback(self._junction.close)
            self._watch = self._watched()
            stack.callback(self._watch.stop)
            self._forwarder.start()
            stack.callback(self._stop)
            self._connect(self._claims)
            self._stack = stack.pop_all()
        return self

    def close(self) -> None:
        """Let pass what is under way, then close everything; safe to call twice."""
        self._stack.close()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, *error: object) -> None:
        self.close()

    def set_intercept(self, keyexprs: Sequence[str]) -> None:
        """Cut other keys from now on, while components stay connected.

        No message crosses twice or against both the old and the new rule; of keys whose rule changes, and natively
        while routes change, some may be lost within about 200 ms.

        Args:
            keyexprs: All key expressions that are intercepted from now on.
        """
        claims = Claims(canonical(keyexprs))
        for expression in self._cuts.keys() - set(claims.expressions):
            release(*self._cuts.pop(expression))
        self._connect(claims)

    def _connect(self, claims: Claims) -> None:
        import zenoh

        if self._junction is not None:
            self._junction.open(claims.expressions)
        for expression in claims.expressions:
            if expression not in self._cuts:
                self._cuts[expression] = [
                    segment.session.declare_subscriber(
                        expression,
                        self._interception(name, expression),
                        allowed_origin=zenoh.Locality.REMOTE,  # what we publish ourselves must not come back
                    )
                    for name, segment in self._segments.items()
                ]
        self._claims = claims
        self._observe()

    def _observe(self) -> None:
        if self._recorder is None:
            return
        if self._junction is not None and self._junction.session is not None:
            # The junction sees every message that is not intercepted once, whichever segment it comes from.
            session, segment = self._junction.session, ""
        else:
            segment = next(iter(self._segments))
            session = self._segments[segment].session
        release(*self._observers)  # those of a former junction are gone already, which does no harm
        converter = Converter(segment, self._sequence)
        self._observers = [
            subscribe(session, expression, take=self._observation(expression), convert=converter)
            for expression in self._record.expressions
        ]

    def _watched(self) -> TransportWatch:
        junction = self._junction
        watch = TransportWatch(
            self._wait_before_close_s,
            junction=lambda: junction.zid if junction is not None else "",
            ours=self.ids_ever,
            longest=lambda name: self._outlets[name].longest_s,
        )
        watch.start(self.sessions)
        return watch

    def _stop(self) -> None:
        release(*itertools.chain(self._observers, *self._cuts.values()))
        self._observers.clear()
        self._cuts.clear()
        wait_until(self._forwarder.idle, _SETTLE_S)
        self._forwarder.close()
        self._dispatcher.close()

    # -- interception -------------------------------------------------------------------------------------------------

    def _interception(self, segment: str, expression: str) -> Callable[[zenoh.Sample], None]:
        convert = self._converters[segment]

        def take(sample: zenoh.Sample) -> None:
            message = convert(sample)
            if self._claims.owner(message.key) == expression:
                self._intercept(message)

        return take

    def _observation(self, expression: str) -> Callable[[Message], None]:
        recorder = self._recorder

        def take(message: Message) -> None:
            key = message.key
            if recorder and self._record.owner(key) == expression and self._claims.owner(key) is None:
                recorder.delivered(message)

        return take

    def _intercept(self, message: Message) -> None:
        if not self._mailbox.offer(message, len(message.payload), patient=message.qos.congestion != "drop"):
            self._count_lost(message)

    def _forward(self, message: Message) -> None:
        targets = self._others.get(message.segment, list(self._names))
        if self._claims.owner(message.key) is None:
            targets = targets[:1]  # an added message on a key that is not cut reaches the others by itself
        for name in targets:
            self._outlets[name].publish(message)

    def _count_lost(self, message: Message) -> None:
        with self._lock:
            self._lost[self._registry.topic(message.key)] += 1

    # -- for players, monitors and trial runners ----------------------------------------------------------------------

    @property
    def sessions(self) -> dict[str, zenoh.Session]:
        """The segments' own sessions."""
        return {name: segment.session for name, segment in self._segments.items()}

    def segment(self, name: str) -> Segment:
        """Return a segment; raises ConfigError if there is none of this name."""
        try:
            return self._segments[name]
        except KeyError:
            hint = did_you_mean(name, self._names) if self._segments else "open the bus first"
            raise ConfigError(f"no segment {name!r}", hint=hint) from None

    def endpoint(self, segment: str) -> str:
        """Return where components of a segment connect."""
        return self.segment(segment).endpoints[0]

    def put(self, segment: str, message: Message) -> None:
        """Publish on a segment as a component there would.

        An intercepted key goes to the segment's components and through the pipeline to the other segments. The call
        blocks if the message's QoS says so and receivers are slow.

        Args:
            segment: Name of the segment.
            message: Its time, sequence and segment are given anew.
        """
        self.segment(segment)
        if self._claims.owner(message.key) is not None:
            self._intercept(message.with_(time=time.time_ns(), segment=segment, sequence=next(self._sequence)))
        self._outlets[segment].publish(message)

    def publisher(self, segment: str, key: str, *, qos: Qos | None = None) -> BusPublisher:
        """Declare a publisher ahead of a fast play.

        Args:
            segment: Name of the segment.
            key: Key without wildcards.
            qos: Delivery settings of everything that is published through it.
        """
        self.segment(segment)
        qos = qos or Qos()
        self._outlets[segment].declare(key, qos)
        return BusPublisher(self, segment, key, qos)

    def subscribe(self, segment: str, keyexpr: str, callback: Callable[[Message], None]) -> Subscription:
        """Observe what is on a segment, what we publish there included.

        Args:
            segment: Name of the segment.
            keyexpr: Key expression.
            callback: Called on one thread for all observers; if it is too slow, messages are counted as lost.

        Returns:
            Something with `undeclare()`.
        """
        session = self.segment(segment).session
        (text,) = canonical([keyexpr])
        self._dispatcher.start()
        return subscribe(
            session,
            text,
            take=lambda message: self._dispatcher.deliver(callback, message),
            convert=self._converters[segment],
        )

    def wait_subscribed(
        self,
        segment: str,
        keyexprs: Sequence[str],
        *,
        timeout: float,
        alive: Callable[[], bool] = lambda: True,
    ) -> list[str]:
        """Wait until components of a segment have subscribed to all key expressions.

        What counts is that somebody outside of the segment's own session would receive the key. That is exact for
        intercepted keys, whose subscriptions the junction keeps apart, unless somebody elsewhere (a recorder of
        `**`, say) subscribes to more than is cut; of other keys, subscribers in other segments count too.

        Args:
            segment: Name of the segment.
            keyexprs: Keys or key expressions; a subscription that intersects one satisfies it.
            timeout: Seconds.
            alive: Returns False when waiting has become pointless, because a component died.

        Returns:
            What nobody has subscribed to; empty when all went well.
        """
        import zenoh

        session = self.segment(segment).session
        # Not by the admin space, which tells it exactly: a query there while somebody declares something can block
        # the whole router for ever (zenoh 1.10.2 locks its tables twice).
        waiting: dict[str, Any] = {
            text: session.declare_publisher(text, allowed_destination=zenoh.Locality.REMOTE)
            for text in canonical(keyexprs)
        }

        def settled() -> bool:
            for text in [text for text, each in waiting.items() if each.matching_status.matching]:
                release(waiting.pop(text))
            return not waiting or not alive()

        try:
            wait_until(settled, timeout, interval=_MATCHING_INTERVAL_S)
            return list(waiting)
        finally:
            release(*waiting.values())

    def drain(self, timeout: float) -> bool:
        """Wait until all messages received so far are through and published, delayed ones included.

        Args:
            timeout: Seconds.

        Returns:
            Whether that happened in time.
        """
        quiet, before = 0, -1

        def drained() -> bool:
            nonlocal quiet, before
            arrived, before = self._mailbox.accepted - before, self._mailbox.accepted
            done = not arrived and self._forwarder.idle() and self._dispatcher.idle()
            quiet = quiet + 1 if done and (self._recorder is None or self._recorder.idle()) else 0
            return quiet >= _QUIET_POLLS

        return wait_until(drained, timeout)

    # -- what happened ------------------------------------------------------------------------------------------------

    @property
    def ids(self) -> set[str]:
        """Ids of the bus's present sessions."""
        own = {segment.zid for segment in self._segments.values()}
        return own | {self._junction.zid} if self._junction is not None and self._junction.zid else own

    @property
    def ids_ever(self) -> set[str]:
        """Ids of all routers that were ever the junction."""
        return self._junction.ids if self._junction is not None else set()

    def counts(self) -> dict[str, TopicCounts]:
        """Return what happened so far, by topic."""
        table: dict[str, TopicCounts] = {}
        for topic, each in list(self._pipeline.counts.items()):
            table[topic] = TopicCounts(each.seen, each.changed, each.dropped, each.added, each.delivered)
        for topic, count in dict(self._recorder.recorded if self._recorder else {}).items():
            table.setdefault(topic, TopicCounts()).recorded = count
        for source in (self.losses.messages, self.losses.recordings):
            for topic, count in source.items():
                table.setdefault(topic, TopicCounts()).lost += count
        return dict(sorted(table.items()))

    @property
    def departures(self) -> int:
        """Number of components that have left, in good order or because they ended."""
        return self._watch.departures if self._watch is not None else 0

    @property
    def losses(self) -> Losses:
        """What was lost so far against everybody's will."""
        with self._lock:
            messages = dict(self._lost)
        links = tuple(self._watch.broken) if self._watch is not None else ()
        return Losses(messages, dict(self._recorder.lost) if self._recorder else {}, links)
