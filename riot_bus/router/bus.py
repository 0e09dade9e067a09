"""The bus: isolated segments, a junction that joins them, and forwarders of the keys that the junction cuts."""

from __future__ import annotations

import threading
import time
from collections import Counter
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Self

from riot_bus.pipeline.runner import Pipeline
from riot_bus.pipeline.stage import stages_of
from riot_bus.router.counts import Losses, TopicCounts, count
from riot_bus.router.cut_keys import CutKeys
from riot_bus.router.delivery_queue import DeliveryQueue
from riot_bus.router.observers import Observers, wait_subscribed
from riot_bus.router.pipeline_executor import BUDGET_S, PipelineExecutor
from riot_bus.router.surroundings import BusAccess, Surroundings
from riot_bus.router.tap import Taps
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.zenoh.convert import Claims
from riot_bus.zenoh.link_watch import TransportWatch
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import canonical, wait_until
from riot_bus.zenoh.session_config import WAIT_BEFORE_CLOSE_S

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from riot_bus.config.router_settings import SegmentSettings
    from riot_bus.interceptors.recorder import Recorder
    from riot_bus.pipeline.stage import Stage
    from riot_bus.router.advanced.publisher_proxies import PublisherProxies
    from riot_bus.router.cut_keys import SourceT
    from riot_bus.router.services.recorded import RecordedService
    from riot_bus.types.port import BridgedLink
    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.client import Subscription
    from riot_bus.zenoh.segments import Segment


class Bus:
    """Segments, their junction and the interception between them; a context manager.

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
        self._services = canonical(services)
        self._recorders = [recorder] if recorder is not None else []
        self._changing = threading.RLock()
        self.executor = PipelineExecutor(pipeline or Pipeline((), registry=self._registry), budget_s=budget_s)
        """The access to the interceptors, to run or to change them."""
        self._access = BusAccess(network.settings)
        present = Surroundings(Claims(canonical(intercept)), recorder)
        self._deliveries = DeliveryQueue(self.executor, self._access, present, topic=self._registry.topic)
        self._taps = Taps(network, self._deliveries, record)
        self._cut = CutKeys(network, self._deliveries, topic=self._registry.topic, joined=self._taps.renew)
        self._observers = Observers(self._registry.topic)
        self._watch = TransportWatch(
            network.wait_before_close_s,
            inner=network.linked,
            ours=lambda: self.ids | self.ids_ever,
            longest=lambda name: self._access.outlets[name].longest_s,
        )
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
            self._network.open(self.intercepted, self._services)
            if self._owns_network:
                stack.callback(self._network.close)
            self._access.open(self.sessions)
            self._watch.start(self.sessions)
            stack.callback(self._watch.stop)
            stack.callback(self.executor.close)
            if len(self.sessions) > 1 or self.intercepted or self._services or self.executor.pipeline.stages:
                self._start_threads()
            self.executor.change(Pipeline.start)
            self._cut.open(spaces=[text for each in self._registry.service_adapters() for text in each.services])
            stack.callback(self._stop)
            self._cut.cut(self.intercepted, self._services, again=False)
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

    def _stop(self) -> None:
        self._cut.close_inner()
        self._taps.close()
        self._cut.close()
        self._deliveries.close()
        self._observers.close()

    # -- what is intercepted and recorded -----------------------------------------------------------------------------

    @property
    def intercepted(self) -> list[str]:
        """The key expressions that are intercepted."""
        return list(self._deliveries.surroundings.claims.expressions)

    @property
    def services(self) -> list[str]:
        """The key expressions of services whose requests and replies are intercepted."""
        return list(self._services)

    @property
    def bridged(self) -> Collection[BridgedLink]:
        """Links of a bridge in this process."""
        return self._bridged()

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
            wanted = self._services if services is None else canonical(services)
            self._cut.cut(canonical(keyexprs), wanted, again=True)
            self._services = wanted

    def set_recorder(self, recorder: Recorder | None) -> None:
        """Record all with another recorder from now on, or with none; the owner of the former one closes it."""
        with self._changing:
            self._deliveries.surround(recorder=recorder)
            self.executor.pipeline.provenance = recorder is not None
            if recorder is not None:
                self._recorders.append(recorder)
            self.forget()
            self._taps.record(["**"])

    def set_interceptors(self, interceptors: Sequence[object]) -> None:
        """Replace the interceptors; those that stay are not started again.

        Raises:
            ConfigError: One of them is not usable; then nothing has changed.
        """
        with self._changing:
            self._check_ways(stages_of(interceptors))
            self._start_threads()
            self.executor.replace(interceptors)
            self.forget()

    def restart(self) -> None:
        """Restart the time and the numbers of intercepted messages at the next message."""
        self.executor.change(Pipeline.restart)
        self.forget()

    def renew(self) -> None:
        """Look up the properties of keys again, since the type of a key has become known."""
        self.executor.change(Pipeline.forget)
        self.forget()

    def forget(self) -> None:
        """Let forwarders ask again what interceptors make of each key; unlike `renew`, this waits for nothing."""
        self._cut.forget()

    def _check_ways(self, stages: Iterable[Stage]) -> None:
        for stage in stages:
            for word, name in (("from", stage.when.source), ("to", stage.when.target)):
                if name is not None and name not in self._network.settings:
                    hint = did_you_mean(name, self._network.settings)
                    raise ConfigError(f"no segment {name!r}", where=f"{stage.name}: {word}", hint=hint)

    # -- for players, monitors and trial runners ----------------------------------------------------------------------

    @property
    def sessions(self) -> dict[str, zenoh.Session]:
        """The segments' own sessions."""
        return self._network.sessions

    def segment(self, name: str) -> Segment:
        """Return a segment; raises ConfigError if there is none of this name."""
        try:
            return self._network.segments[name]
        except KeyError:
            hint = did_you_mean(name, self._network.settings) if self.sessions else "open the bus first"
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
        if self._deliveries.owner(message.key) is not None:
            self._deliveries.send(
                message.with_(time=time.time_ns(), segment=segment, sequence=next(self._access.sequence))
            )
        self._access.outlets[segment].publish(message)

    def deliver(self, segment: str, message: Message) -> bool:
        """Publish to the components of one segment only, bypassing the pipeline, if one has subscribed; see `put`.

        Returns:
            Whether a component has subscribed. That is exact for intercepted keys; see `wait_subscribed`.
        """
        heard = self._observers.hears(self.segment(segment), message.key)
        if heard:
            self._access.outlets[segment].publish(message)
        return heard

    def attach(self, make: Callable[[DeliveryQueue, PublisherProxies | None], SourceT]) -> SourceT:
        """Return a source of messages of a bridge in this process; it is closed with the bus.

        Args:
            make: Function that makes it, of the queue that takes messages through the pipeline, and of the proxies of
                advanced publishers, if there are other segments.
        """
        return self._cut.attach(make)

    def show(self, links: Callable[[], Collection[BridgedLink]]) -> None:
        """Include the links of a bridge in this process in graphs of this bus.

        Args:
            links: Function that returns the present links; called on any thread.
        """
        self._bridged = links

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
        place = self.segment(segment)
        (text,) = canonical([keyexpr])
        self._deliveries.observe(segment)
        self.forget()
        return self._observers.subscribe(place, text, callback, own=own, convert=self._access.converters[segment])

    def serve(self, segment: str, key: str, service: RecordedService, *, tokens: Sequence[str] = ()) -> None:
        """Answer service calls of a segment's components with recorded replies until the bus closes."""
        self._observers.serve(self.segment(segment).session, key, service, tokens)

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
        return wait_subscribed(self.segment(segment).session, canonical(keyexprs), timeout=timeout, alive=alive)

    def drain(self, timeout: float) -> bool:
        """Wait until all messages received so far are processed and published, delayed ones included.

        Returns:
            Whether that happened in time.
        """
        quiet, before = 0, -1

        def drained() -> bool:
            nonlocal quiet, before
            received = self._cut.received()
            arrived, before = received - before, received
            quiet = quiet + 1 if not arrived and self.idle() else 0
            return quiet >= 3  # 1 ms apart: an idle forwarder may hold a message not counted yet

        return wait_until(drained, timeout)

    def give_up_delayed(self) -> None:
        """Discard the messages that interceptors have delayed so far, and count them as lost."""
        self._deliveries.give_up()

    def idle(self) -> bool:
        """Return whether no received message is still waiting here; more may be on their way."""
        recorder = self._deliveries.surroundings.recorder
        return (
            self._cut.idle()
            and self._taps.idle()
            and not self._deliveries.held()
            and self._observers.idle()
            and (recorder is None or recorder.idle())
        )

    # -- what happened ------------------------------------------------------------------------------------------------

    @property
    def ids(self) -> set[str]:
        """Ids of the bus's present sessions."""
        return {segment.zid for segment in self._network.segments.values()} | self._network.linked()

    @property
    def ids_ever(self) -> set[str]:
        """Ids of all routers that were ever the junction."""
        return self._network.junction.ids if self._network.junction is not None else set()

    def counts(self) -> dict[str, TopicCounts]:
        """Return, by topic, the counts of intercepted messages so far, and of all messages recorded."""
        passed = self._cut.passed()  # first: the pipeline is told of some messages only then
        return count(
            self.executor.pipeline.counts,
            passed=passed,
            shed=self._cut.shed(),
            undelivered=_sum(self._deliveries.losses().values()),
            held=self._deliveries.held() + self._cut.held(),
            recorded=_sum(recorder.recorded for recorder in self._recorders),
            unrecorded=self._unrecorded(),
        )

    def flows(self) -> dict[tuple[str, str], int]:
        """Return the number of intercepted messages received so far, by key and source segment."""
        return self._cut.flows()

    def senders(self) -> dict[tuple[str, str], set[str]]:
        """Return the ids of the components that timestamped intercepted messages, by key and segment.

        A component timestamps its messages only if its configuration says so (`timestamping/enabled`).
        """
        return self._cut.senders(self.ids)

    @property
    def departures(self) -> int:
        """Number of components that have left, in good order or because they ended."""
        return self._watch.departures

    @property
    def losses(self) -> Losses:
        """The unintended losses so far."""
        parts = {reason: +topics for reason, topics in self._deliveries.losses().items()}
        parts["no room"] = self._cut.shed()
        parts["observer too slow"] = +self._observers.slow.copy()
        reasons = {reason: sum(topics.values()) for reason, topics in parts.items() if topics}
        return Losses(dict(_sum(parts.values())), dict(self._unrecorded()), tuple(self._watch.broken), reasons)

    def _unrecorded(self) -> Counter[str]:
        return _sum(recorder.lost.copy() for recorder in self._recorders)


def _sum(parts: Iterable[Mapping[str, int]]) -> Counter[str]:
    total: Counter[str] = Counter()
    for part in parts:
        total.update(part)
    return total
