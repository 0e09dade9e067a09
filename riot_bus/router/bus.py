"""The bus: isolated segments, a junction that joins them, and forwarders of the keys that the junction cuts."""

from __future__ import annotations

import itertools
import threading
import time
from collections import Counter
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Any, Self

from riot_bus.pipeline.mailbox import Dispatcher
from riot_bus.pipeline.runner import BoundedCounts, Pipeline
from riot_bus.pipeline.stage import stages_of
from riot_bus.router.advanced.proxy_publisher import StoreFilter
from riot_bus.router.advanced.publisher_proxies import PublisherProxies
from riot_bus.router.counts import Losses, TopicCounts, count
from riot_bus.router.delivery_queue import DeliveryQueue
from riot_bus.router.forwarder import Forwarder
from riot_bus.router.local_ingress import LocalIngress
from riot_bus.router.pipeline_executor import BUDGET_S, PipelineExecutor
from riot_bus.router.services.recorded import serve_recorded
from riot_bus.router.services.services import Services
from riot_bus.router.tap import Tap
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.zenoh.convert import Claims, Converter
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.link_watch import TransportWatch
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import canonical, includes, intersects, release, wait_until
from riot_bus.zenoh.session_config import WAIT_BEFORE_CLOSE_S

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from riot_bus.config.router_settings import SegmentSettings
    from riot_bus.interceptors.recorder import Recorder
    from riot_bus.pipeline.stage import Stage
    from riot_bus.router.audience import Inner
    from riot_bus.router.services.recorded import RecordedService
    from riot_bus.types.port import BridgedLink
    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.client import Subscription
    from riot_bus.zenoh.junction import Junction
    from riot_bus.zenoh.segments import Segment

_ALIVE_INTERVAL_S = 0.02  # how late a component's end is noticed; a subscription ends the wait at once
_HEARD_S = 10.0  # ten interceptors may block one after the other, each for `BUDGET_S`, 1 s
_QUIET_POLLS = 3  # 1 ms apart: an idle forwarder may hold a message not counted yet


class Bus:
    """Segments, their junction and the interception between them; a context manager.

    Several may live in one process.

    Args:
        segments: A network, which stays open when the bus is closed; or by name, each segment's settings, or just the
            endpoints to listen on, where no endpoint means a free port of this machine.
        intercept: Key expressions whose messages go through the pipeline instead of the junction.
        services: Key expressions of services whose requests and replies go through the pipeline, too.
        pipeline: Interceptors; without one, intercepted messages pass unchanged. Closed by its owner.
        registry: Registry that gives the names of topics in counts.
        recorder: Recorder of intercepted messages and of `record`. Closed by its owner, after the bus.
        record: Key expressions that are recorded without being intercepted.
        wait_before_close_s: Longest wait of a BLOCK publication for a slow receiver, after which its link is closed.
        budget_s: Longest time of an interceptor for one message, after which it is bypassed.
        config: Further Zenoh configuration of every segment, ignored if `segments` is a network.
        timeout: Seconds within which everything must be up.
    """

    def __init__(
        self,
        segments: Network | Mapping[str, SegmentSettings | Sequence[str]],
        *,
        intercept: Sequence[str] = (),
        services: Sequence[str] = (),
        pipeline: Pipeline | None = None,
        registry: TypeRegistry | None = None,
        recorder: Recorder | None = None,
        record: Sequence[str] = (),
        wait_before_close_s: float = WAIT_BEFORE_CLOSE_S,
        budget_s: float = BUDGET_S,
        config: Mapping[str, Any] | None = None,
        timeout: float = 10.0,
    ) -> None:
        self._owns_network = not isinstance(segments, Network)
        if not isinstance(segments, Network):
            segments = Network(segments, config=config, wait_before_close_s=wait_before_close_s, timeout=timeout)
        self._network = network = segments
        self._registry = registry or TypeRegistry()
        self._forwarders: dict[str, list[Forwarder]] = {}
        self._retired: list[Forwarder] = []
        self._ingresses: list[LocalIngress] = []
        self._taps: list[Tap] = []
        self._tokens: dict[str, Any] = {}
        self._claims = Claims(canonical(intercept))
        self._selected = canonical(services)
        self._record = Claims(canonical(record))
        self._recorder = recorder
        self._recorders: list[Recorder] = [recorder] if recorder is not None else []
        self._changing = threading.RLock()
        self.executor = PipelineExecutor(pipeline or Pipeline((), registry=self._registry), budget_s=budget_s)
        """The access to the interceptors, to run or to change them."""
        self._deliveries = DeliveryQueue(
            self.executor,
            network.settings,
            owner=lambda key: self._claims.owner(key),
            topic=self._registry.topic,
        )
        self._deliveries.recorder = recorder
        self._advanced: PublisherProxies | None = None
        self._services: Services | None = None
        self._probes: dict[tuple[str, str], zenoh.Publisher] = {}
        self._declared: list[Any] = []
        self._slow = BoundedCounts()
        self._dispatcher = Dispatcher("riot-observe", self._count_slow)
        self._watch: TransportWatch | None = None
        self._bridged: Callable[[], Collection[BridgedLink]] = tuple
        self._stack = ExitStack()

    # -- life ---------------------------------------------------------------------------------------------------------

    def open(self) -> Self:
        """Open everything; return once routes are up.

        Raises:
            ConfigError: Zenoh refuses a configuration.
            EnvironmentFaultError: A port is in use, or the machine is too slow.
        """
        self._check_ways(self.executor.pipeline.stages)
        with ExitStack() as stack:
            self._network.open(self._claims.expressions, self._selected)
            if self._owns_network:
                stack.callback(self._network.close)
            self._deliveries.open(self.sessions)
            self._watch = self._watched()
            stack.callback(self._watch.stop)
            stack.callback(self.executor.close)
            if len(self._segments) > 1 or self._claims.expressions or self._selected or self.executor.pipeline.stages:
                self._start_threads()
            self.executor.change(Pipeline.start)
            if len(self._segments) > 1:
                self._advanced = self._deliveries.advanced = PublisherProxies(
                    self._deliveries, changed=self._forget, fence=self._fence
                )
                spaces = [text for each in self._registry.service_adapters() for text in each.services]
                self._services = Services(self._deliveries, spaces=spaces)
            stack.callback(self._stop)
            self._intercept(self._claims.expressions, self._selected, again=False)
            self._stack = stack.pop_all()
        return self

    def _start_threads(self) -> None:
        """Start the threads of the pipeline, which a single segment without interception does not need."""
        self.executor.start()
        self._deliveries.start()

    def close(self) -> None:
        """Forward the messages in transit, then close everything but a network of others; safe to call twice."""
        self._stack.close()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _watched(self) -> TransportWatch:
        watch = TransportWatch(
            self._network.wait_before_close_s,
            inner=self._network.linked,
            ours=lambda: self.ids | self.ids_ever,
            longest=lambda name: self._deliveries.outlets[name].longest_s,
        )
        watch.start(self.sessions)
        return watch

    def _stop(self) -> None:
        for ingress in self._ingresses:
            ingress.close()
        release(*self._taps, *self._probes.values())
        self._taps.clear()
        if self._services is not None:
            self._services.close()
        for expression in list(self._forwarders):
            self._retire(expression)
        if self._advanced is not None:
            self._advanced.close()
        self._deliveries.close()
        self._dispatcher.close()
        for each in (*self._declared, *self._tokens.values()):
            with suppress(library_of(each).ZError):  # its user has undeclared it
                release(each)
        self._declared.clear()
        self._tokens.clear()

    @property
    def _segments(self) -> dict[str, Segment]:
        return self._network.segments

    @property
    def _junction(self) -> Junction | None:
        return self._network.junction

    # -- what is intercepted and recorded -----------------------------------------------------------------------------

    @property
    def intercepted(self) -> list[str]:
        """The key expressions that are intercepted."""
        return list(self._claims.expressions)

    @property
    def bridged(self) -> Collection[BridgedLink]:
        """Links of a bridge in this process."""
        return self._bridged()

    @property
    def services(self) -> list[str]:
        """The key expressions of services whose requests and replies are intercepted."""
        return list(self._selected)

    def set_intercept(self, keyexprs: Sequence[str], *, services: Sequence[str] | None = None) -> None:
        """Intercept other keys from now on, while components stay connected.

        No messages of keys that were and stay intercepted are lost. Messages of other keys may be lost for about
        100 ms while routes change; no message crosses on both ways. Pending calls may end without a reply then.

        Args:
            keyexprs: All key expressions that are intercepted from now on.
            services: All key expressions of services that are intercepted from now on; None for the present ones.
        """
        with self._changing:
            self._start_threads()
            selected = self._selected if services is None else canonical(services)
            self._intercept(canonical(keyexprs), selected, again=True)

    def set_recorder(self, recorder: Recorder | None, *, record: Sequence[str] = ("**",)) -> None:
        """Record with another recorder from now on, or with none; the owner of the former one closes it.

        Args:
            recorder: Recorder of intercepted messages and of `record`.
            record: Key expressions that are recorded without being intercepted.
        """
        with self._changing:
            self._recorder = self._deliveries.recorder = recorder
            self.executor.pipeline.provenance = recorder is not None
            if recorder is not None:
                self._recorders.append(recorder)
            self._record = Claims(canonical(record))
            self._forget()
            self._observe()

    def set_interceptors(self, interceptors: Sequence[object]) -> None:
        """Replace the interceptors; those that stay are not started again.

        Raises:
            ConfigError: One of them is not usable; then nothing has changed.
        """
        with self._changing:
            self._check_ways(stages_of(interceptors))
            self._start_threads()
            self.executor.replace(interceptors)
            self._forget()

    def restart(self) -> None:
        """Restart the time and the numbers of intercepted messages at the next message."""
        self.executor.change(Pipeline.restart)
        self._forget()

    def renew(self) -> None:
        """Look up the properties of keys again, since the type of a key has become known."""
        self.executor.change(Pipeline.forget)
        self._forget()

    def forget(self) -> None:
        """Let forwarders ask again what interceptors make of each key; unlike `renew`, this waits for nothing."""
        self._forget()

    def _check_ways(self, stages: Iterable[Stage]) -> None:
        for stage in stages:
            for word, name in (("from", stage.when.source), ("to", stage.when.target)):
                if name is not None and name not in self._network.settings:
                    hint = did_you_mean(name, self._network.settings)
                    raise ConfigError(f"no segment {name!r}", where=f"{stage.name}: {word}", hint=hint)

    def _intercept(self, expressions: list[str], services: list[str], *, again: bool) -> None:
        """Cut these; forwarders stay as long as they may have messages, since a new one would start with a gap."""
        if self._junction is not None:
            self._junction.settle()  # while everything still crosses
        kept = [text for text in self._forwarders if any(intersects(each, text) for each in expressions)]
        new = [text for text in expressions if not any(includes(each, text) for each in kept)]
        self._claims = Claims(expressions, owners=kept, within=self._claims)  # what was intercepted and will be
        self._forget()
        for expression in self._forwarders.keys() - set(kept):
            self._retire(expression)
        if self._advanced is not None:
            self._watch_advanced(expressions, self._advanced.watched, within=True, again=again)
        if self._services is not None:
            self._services.retire(services)
        if self._junction is not None:
            self._junction.open(expressions, services)
        self._selected = services
        if self._services is not None:
            self._services.select(services)
        self._claims = Claims(expressions, owners=[*kept, *new])
        for expression in new:
            self._forwarders[expression] = [Forwarder(name, expression, self._deliveries) for name in self._segments]
        self._forget()
        self._observe()
        if self._advanced is not None:
            self._watch_advanced(expressions, self._advanced.watched, within=False, again=again)

    def _watch_advanced(self, expressions: list[str], former: list[str], *, within: bool, again: bool) -> None:
        """Watch these expressions; `within` limits it to those that both the former and the next junction cut."""
        assert self._advanced is not None
        for text in expressions:
            if text not in former and (not within or any(includes(each, text) for each in former)):
                self._advanced.watch(text, again=again)
        for text in former:
            if text not in expressions and not (within and any(includes(each, text) for each in expressions)):
                self._advanced.unwatch(text)

    def _retire(self, expression: str) -> None:
        for forwarder in self._forwarders.pop(expression):
            forwarder.close()
            if forwarder.received or forwarder.shed:  # else each change would make counting slower
                self._retired.append(forwarder)

    def _forget(self) -> None:
        for source in self._present_sources():
            source.forget()

    def _observe(self) -> None:
        release(*self._taps)  # harmless for the taps of a former junction, which have already ended
        self._taps = []
        if self._recorder is None:
            return
        if self._junction is not None and self._junction.session is not None:
            # The junction sees every message that is not intercepted once, whichever segment it comes from.
            session, segment = self._junction.session, ""
        else:
            segment = next(iter(self._segments))
            session = self._segments[segment].session
        converter = Converter(segment, self._deliveries.sequence)
        self._taps = [
            Tap(session, expression, take=self._observation(expression), convert=converter)
            for expression in self._record.expressions
            # Lanes record what is intercepted; a tap on it would look like a subscriber in each segment.
            if not any(includes(each, expression) for each in self._claims.expressions)
        ]

    def _observation(self, expression: str) -> Callable[[Message], None]:
        def take(message: Message) -> None:
            key, recorder = message.key, self._recorder
            if recorder and self._record.owner(key) == expression and self._claims.owner(key) is None:
                recorder.delivered(message)

        return take

    # -- for players, monitors and trial runners ----------------------------------------------------------------------

    @property
    def sessions(self) -> dict[str, zenoh.Session]:
        """The segments' own sessions."""
        return self._network.sessions

    def segment(self, name: str) -> Segment:
        """Return a segment; raises ConfigError if there is none of this name."""
        try:
            return self._segments[name]
        except KeyError:
            hint = did_you_mean(name, self._network.settings) if self._segments else "open the bus first"
            raise ConfigError(f"no segment {name!r}", hint=hint) from None

    def endpoint(self, segment: str) -> str:
        """Return the endpoint to which components of a segment connect."""
        return self.segment(segment).endpoints[0]

    def put(self, segment: str, message: Message) -> None:
        """Publish on a segment as a component there would.

        An intercepted key goes to the segment's components and through the pipeline to the other segments. The call
        blocks if the message's QoS says so and receivers are slow.

        Args:
            segment: Name of the segment.
            message: Message whose time, sequence and segment are replaced.
        """
        self.segment(segment)
        if self._claims.owner(message.key) is not None:
            self._deliveries.send(
                message.with_(time=time.time_ns(), segment=segment, sequence=next(self._deliveries.sequence))
            )
        self._deliveries.outlets[segment].publish(message)

    def deliver(self, segment: str, message: Message) -> bool:
        """Publish to the components of one segment only, bypassing the pipeline, if one has subscribed; see `put`.

        Returns:
            Whether a component has subscribed. That is exact for intercepted keys; see `wait_subscribed`.
        """
        probe = self._probes.get((segment, message.key))
        if probe is None:
            session = self.segment(segment).session
            pin(session, message.key)
            remote = library_of(session).Locality.REMOTE
            probe = self._probes[segment, message.key] = session.declare_publisher(
                message.key, allowed_destination=remote
            )
        heard = bool(getattr(probe.matching_status, "matching", True))
        if heard:
            self._deliveries.outlets[segment].publish(message)
        return heard

    def local_ingress(self, segment: str) -> LocalIngress:
        """Return the path to the other segments for a bridge in this process; it is closed with the bus.

        Args:
            segment: Name of the segment that the messages come from.
        """
        self.segment(segment)
        ingress = LocalIngress(segment, self._deliveries)
        self._ingresses.append(ingress)
        return ingress

    def show(self, links: Callable[[], Collection[BridgedLink]]) -> None:
        """Include the links of a bridge in this process in graphs of this bus.

        Args:
            links: Function that returns the present links; called on any thread.
        """
        self._bridged = links

    def listen(self, segment: str, inner: Inner) -> Callable[[], None]:
        """Let local ingresses of other segments directly call a bridge in this process that listens to a segment.

        Args:
            segment: Name of the segment.
            inner: The bridge; it also subscribes, to get the messages that come on other ways.

        Returns:
            A function that ends the direct calls.
        """
        deliveries = self._deliveries
        with self._changing:
            deliveries.inner[segment] = (*deliveries.inner.get(segment, ()), inner)
            self._forget()

        def end() -> None:
            wait_until(
                lambda: all(ingress.idle() for ingress in self._ingresses), _HEARD_S
            )  # it still gets what was put before
            with self._changing:
                deliveries.inner[segment] = tuple(each for each in deliveries.inner[segment] if each is not inner)
                self._forget()

        return end

    def subscribe(
        self, segment: str, keyexpr: str, callback: Callable[[Message], None], *, own: bool = True
    ) -> Subscription:
        """Observe the messages on a segment.

        Args:
            segment: Name of the segment.
            keyexpr: Key expression of the messages.
            callback: Function called on one thread for all observers; if too slow, messages are counted as lost.
            own: Whether to observe also what this process publishes there.

        Returns:
            An object with `undeclare()`, which ends the observation.
        """
        session, convert = self.segment(segment).session, self._deliveries.converters[segment]
        (text,) = canonical([keyexpr])
        self._dispatcher.start()
        only_stored = StoreFilter(self.segment(segment).zid)
        self._deliveries.observed.add(segment)
        self._forget()

        def take(sample: zenoh.Sample) -> None:
            if not only_stored(sample):
                self._dispatcher.deliver(callback, convert(sample))

        pin(session, text)
        locality = library_of(session).Locality
        subscriber = session.declare_subscriber(text, take, allowed_origin=locality.ANY if own else locality.REMOTE)
        self._declared.append(subscriber)
        return subscriber

    def serve(self, segment: str, key: str, service: RecordedService, *, tokens: Sequence[str] = ()) -> None:
        """Answer service calls of a segment's components with recorded replies until the bus closes.

        Args:
            segment: Name of the segment.
            key: Key of the service.
            service: The recorded service.
            tokens: Liveliness tokens by which callers find the service; those already declared are kept.
        """
        session = self.segment(segment).session
        self._declared.append(serve_recorded(session, key, service))
        for token in tokens:
            if token not in self._tokens:
                self._tokens[token] = session.liveliness().declare_token(token)

    def wait_subscribed(
        self,
        segment: str,
        keyexprs: Sequence[str],
        *,
        timeout: float,
        alive: Callable[[], bool] = lambda: True,
    ) -> list[str]:
        """Wait until components of a segment have subscribed to all key expressions.

        A key counts as subscribed if a session other than the segment's own would receive it. That is exact for
        intercepted keys, whose subscriptions the junction keeps apart, unless a subscriber elsewhere (such as a
        recorder of `**`) subscribes to more than is cut; for other keys, subscribers in other segments count, too.

        Args:
            segment: Name of the segment.
            keyexprs: Keys or key expressions; a subscription that intersects one satisfies it.
            timeout: Longest time to wait, in seconds.
            alive: Function that returns False when waiting is pointless, because a component died.

        Returns:
            The key expressions without subscribers; empty on success.
        """
        session = self.segment(segment).session
        zenoh = library_of(session)
        # The admin space would give an exact answer, but a query there during a declaration can block the whole
        # router for ever (zenoh 1.10.2 locks its tables twice).
        waiting: dict[str, Any] = {}
        listeners: dict[str, Any] = {}
        changed = threading.Event()
        deadline = time.monotonic() + timeout
        try:
            for text in canonical(keyexprs):
                pin(session, text)
                waiting[text] = session.declare_publisher(text, allowed_destination=zenoh.Locality.REMOTE)
                handler: Any = zenoh.handlers.Callback(lambda status: changed.set(), indirect=False)
                listeners[text] = waiting[text].declare_matching_listener(handler)
            while True:
                changed.clear()
                for text in [text for text, each in waiting.items() if each.matching_status.matching]:
                    release(listeners.pop(text), waiting.pop(text))
                left = deadline - time.monotonic()
                if not waiting or left <= 0 or not alive():
                    return list(waiting)
                changed.wait(min(left, _ALIVE_INTERVAL_S))
        finally:
            release(*listeners.values(), *waiting.values())

    def drain(self, timeout: float) -> bool:
        """Wait until all messages received so far are processed and published, delayed ones included.

        Args:
            timeout: Longest time to wait, in seconds.

        Returns:
            Whether that happened in time.
        """
        quiet, before = 0, -1

        def drained() -> bool:
            nonlocal quiet, before
            forwarders = list(itertools.chain(*self._forwarders.values()))
            received = sum(forwarder.received for forwarder in forwarders)
            arrived, before = received - before, received
            quiet = quiet + 1 if not arrived and self.idle() else 0
            return quiet >= _QUIET_POLLS

        return wait_until(drained, timeout)

    def give_up_delayed(self) -> None:
        """Discard the messages that interceptors have delayed so far, and count them as lost."""
        self._deliveries.give_up()

    def idle(self) -> bool:
        """Return whether no received message is still waiting here; more may be on their way."""
        return (
            all(source.idle() for source in (*self._present_sources(), *self._taps))
            and not self._deliveries.held()
            and self._dispatcher.idle()
            and (self._advanced is None or self._advanced.idle())
            and (self._services is None or self._services.idle())
            and (self._recorder is None or self._recorder.idle())
        )

    # -- what happened ------------------------------------------------------------------------------------------------

    @property
    def ids(self) -> set[str]:
        """Ids of the bus's present sessions."""
        return {segment.zid for segment in self._segments.values()} | self._network.linked()

    @property
    def ids_ever(self) -> set[str]:
        """Ids of all routers that were ever the junction."""
        return self._network.junction.ids if self._network.junction is not None else set()

    def counts(self) -> dict[str, TopicCounts]:
        """Return, by topic, the counts of intercepted messages so far, and of all messages recorded."""
        undelivered: Counter[str] = Counter()
        for topics in self._deliveries.losses().values():
            undelivered.update(topics)
        passed = self._by_topic(source.passed() for source in self._all_sources())
        return count(
            self.executor.pipeline.counts,
            passed=passed,
            shed=self._shed(),
            undelivered=undelivered,
            held=self._deliveries.held() + self._by_topic([] if self._services is None else [self._services.held()]),
            recorded=self._recordings("recorded"),
            unrecorded=self._recordings("lost"),
        )

    def flows(self) -> dict[tuple[str, str], int]:
        """Return the number of intercepted messages received so far, by key and source segment."""
        total: Counter[tuple[str, str]] = Counter()
        for source in self._all_sources():
            for key, number in source.flows().items():
                total[key, source.segment] += number
        return dict(total)

    def senders(self) -> dict[tuple[str, str], set[str]]:
        """Return the ids of the components that timestamped intercepted messages, by key and segment.

        A component timestamps its messages only if its configuration says so (`timestamping/enabled`).
        """
        found: dict[tuple[str, str], set[str]] = {}
        for forwarder in self._all_forwarders():
            for key, zids in forwarder.senders().items():
                found.setdefault((key, forwarder.segment), set()).update(zids - self.ids)
        return found

    def _fence(self, segment: str) -> Callable[[], bool]:
        """Return a test, to be asked twice, whether forwarders have taken all messages of a segment up to now."""
        fences = [forwarder.fence() for forwarder in self._all_forwarders() if forwarder.segment == segment]
        return lambda: all(fence() for fence in fences)

    def _all_forwarders(self) -> list[Forwarder]:
        return [*self._retired, *itertools.chain(*list(self._forwarders.values()))]

    def _present_sources(self) -> list[Forwarder | LocalIngress]:
        return [*itertools.chain(*list(self._forwarders.values())), *self._ingresses]

    def _all_sources(self) -> list[Forwarder | LocalIngress]:
        return [*self._all_forwarders(), *self._ingresses]

    def _by_topic(self, parts: Iterable[Mapping[str, int]]) -> Counter[str]:
        total: Counter[str] = Counter()
        for part in parts:
            for key, number in dict(part).items():
                total[self._registry.topic(key)] += number
        return total

    def _shed(self) -> Counter[str]:
        calls = [] if self._services is None else self._services.shed()
        return self._by_topic([*(forwarder.shed for forwarder in self._all_forwarders()), *calls])

    def _recordings(self, which: str) -> Counter[str]:
        total: Counter[str] = Counter()
        for recorder in self._recorders:
            total.update(getattr(recorder, which).copy())
        return total

    def _count_slow(self, message: Message) -> None:
        self._slow.add(self._registry.topic(message.key))

    @property
    def departures(self) -> int:
        """Number of components that have left, in good order or because they ended."""
        return self._watch.departures if self._watch is not None else 0

    @property
    def losses(self) -> Losses:
        """The unintended losses so far."""
        parts = {reason: +topics for reason, topics in self._deliveries.losses().items()}
        parts["no room"] = self._shed()
        parts["observer too slow"] = +self._slow.copy()
        messages: Counter[str] = Counter()
        for topics in parts.values():
            messages.update(topics)
        links = tuple(self._watch.broken) if self._watch is not None else ()
        reasons = {reason: sum(topics.values()) for reason, topics in parts.items() if topics}
        return Losses(dict(messages), dict(self._recordings("lost")), links, reasons)
