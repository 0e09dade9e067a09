"""The network of one trial: its segments, what is published to components, and what they publish.

Segments stay open between trials: opening, joining and closing them took a third of a short trial.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, Self

from riot_bus.router.bus import Bus
from riot_bus.vocabulary.message import Qos
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import canonical, release, wait_until

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import zenoh

    from riot_bus.pipeline.runner import Pipeline
    from riot_bus.router.services.recorded import RecordedService
    from riot_bus.trial.context import Context
    from riot_bus.vocabulary.message import Message

Subscribe = Callable[[str, Callable[["Message"], None]], None]
"""Function that subscribes a callback to the messages of a key expression."""

_ANY_PORT = ("tcp/127.0.0.1:0",)
_LEAVE_S = 2.0
"""Processes that have ended leave at once; after this time, even on a loaded machine, a new network is certain."""


class _Kind(NamedTuple):
    """The names of segments, the intercepted key expressions, and the longest wait of a publication, in seconds."""

    segments: tuple[str, ...]
    cut: tuple[str, ...]
    wait_before_close_s: float


class KeptNetwork:
    """At most one network on free ports that is free for the next trial; trials that differ get new ones."""

    def __init__(self) -> None:
        self._free: tuple[_Kind, Network] | None = None
        self._lent: dict[Network, _Kind] = {}

    def take(self, segments: Sequence[str], cut: Sequence[str], *, wait_before_close_s: float) -> Network:
        """Return a network for one trial: the free one if it is of this kind and empty, else one to be opened."""
        kind, free = _Kind(tuple(segments), tuple(canonical(cut)), wait_before_close_s), self._free
        self._free = None
        if free is not None and free[0] == kind and wait_until(lambda: _is_empty(free[1]), _LEAVE_S):
            network = free[1]
        else:
            if free is not None:
                free[1].close()
            anywhere = dict.fromkeys(segments, _ANY_PORT)
            network = Network(anywhere, wait_before_close_s=wait_before_close_s)
        self._lent[network] = kind
        return network

    def give_back(self, network: Network, *, usable: bool) -> None:
        """Keep a network for the next trial, or close it."""
        kind = self._lent.pop(network)
        if usable:
            self.close()
            self._free = kind, network
        else:
            network.close()

    def close(self) -> None:
        """Close the free network, if there is one."""
        free, self._free = self._free, None
        if free is not None:
            free[1].close()


def _is_empty(network: Network) -> bool:
    """Return whether no component is connected, and no segment still knows of a subscription of an earlier one."""
    ours = network.linked() | {segment.zid for segment in network.segments.values()}
    for segment in network.segments.values():
        if not segment.peers() <= ours:
            return False
    for segment in network.segments.values():
        segment.flush(ours - {segment.zid})
    return not any(map(_is_heard, network.sessions.values()))


def _is_heard(session: zenoh.Session) -> bool:
    """Return whether any other session, here or in another segment, would receive messages of some key."""
    publisher = session.declare_publisher("**", allowed_destination=library_of(session).Locality.REMOTE)
    try:
        return bool(getattr(publisher.matching_status, "matching", True))
    finally:
        release(publisher)


class TrialNetwork:
    """Segments of their own for the components of a trial; a context manager.

    Args:
        segments: Names of the segments; empty for one segment for each component, with its name.
        intercept: Key expressions that are cut and passed through `pipeline`.
        stall: Seconds after which a component that takes no messages loses its link.
        attach: Components of the trial; if one runs already, its segment listens on the address that it connects to.
        kept: Network that is kept between trials; without it, segments are opened and closed.

    Attributes:
        inputs: Messages that were published to components, in order.
        outputs: Collected messages of components, in order of reception.
        now: Function that returns the time of published messages, in nanoseconds.
    """

    def __init__(
        self,
        context: Context,
        *,
        segments: Sequence[str],
        intercept: Sequence[str] = (),
        pipeline: Pipeline | None = None,
        stall: float = 10.0,
        attach: Iterable[str] = (),
        kept: KeptNetwork | None = None,
    ) -> None:
        self.inputs: list[Message] = []
        self.outputs: list[Message] = []
        self.now: Callable[[], int] = time.time_ns
        self._context, self._apart = context, not segments
        self._watched: list[str] = []
        self._services: list[RecordedService] = []
        self._attached_at: set[str] = set()
        addresses: dict[str, tuple[str, ...]] = dict.fromkeys(segments or context.file.components, _ANY_PORT)
        for name in attach:
            if (address := context.file.components[name].attach) is not None:
                addresses[self.segment_of(name)] += (address,)
                self._attached_at.add(address)
        self._kept = None if self._attached_at else kept
        self._network: Network | None = None
        if self._kept is not None:
            self._network = self._kept.take(list(addresses), intercept, wait_before_close_s=stall)
        self.bus = Bus(
            self._network or addresses,
            intercept=intercept,
            pipeline=pipeline,
            registry=context.registry,
            wait_before_close_s=stall,
        )

    def __enter__(self) -> Self:
        try:
            self.bus.open()
        except BaseException:
            self._give_back(usable=False)
            raise
        return self

    def __exit__(self, error: object, *_: object) -> None:
        usable = error is None and not self.bus.losses.links
        try:
            self.bus.close()
        finally:
            self._give_back(usable=usable)

    def _give_back(self, *, usable: bool) -> None:
        if self._kept is not None and self._network is not None:
            self._kept.give_back(self._network, usable=usable)

    def segment_of(self, name: str) -> str:
        """Return the segment that a component connects to."""
        return name if self._apart else self._context.file.segment_of(self._context.file.components[name])

    def endpoint(self, segment: str) -> str:
        """Return where components of a segment connect that are started."""
        return next(each for each in self.bus.segment(segment).endpoints if each not in self._attached_at)

    def connected(self, segment: str) -> int:
        """Return how many sessions of components a segment has."""
        return len(self.bus.segment(segment).peers() - self.bus.ids)

    def serve(self, segment: str, key: str, service: RecordedService, *, number: int) -> None:
        """Answer the calls of a service on a segment; `number` is another one for each service."""
        self._services.append(service)
        tokens = self._context.registry.server_tokens(key, self.bus.segment(segment).zid, number)
        self.bus.serve(segment, key, service, tokens=tokens)

    def restart(self) -> None:
        """Discard what was observed, for another run of the same components."""
        self.outputs, self.inputs = [], []
        self._watched.clear()
        for service in self._services:
            service.restart()

    def watch_outputs(self, topics: Iterable[str], subscribe: Subscribe) -> None:
        """Collect the messages of some topics, each once though several of the topics have it."""
        for expression in self._context.topics(*topics):
            earlier = tuple(self._watched)

            def take(message: Message, earlier: Sequence[str] = earlier) -> None:
                if not any(self._context.registry.matches(each, message.key) for each in earlier):
                    self.outputs.append(message)

            self._watched.append(expression)
            subscribe(expression, take)

    def watch_all_outputs(self, *, segment: str, inputs: Sequence[str]) -> None:
        """Collect whatever components publish on a segment, but for some topics."""
        matches = self._context.registry.matches
        known: dict[str, bool] = {}

        def take(message: Message) -> None:
            if message.key not in known:
                known[message.key] = not any(matches(topic, message.key) for topic in inputs)
            if known[message.key]:
                self.outputs.append(message)

        self.bus.subscribe(segment, "**", take, own=False)

    def put(self, segment: str, message: Message, *, batched: bool = False) -> None:
        """Publish an input; it waits if receivers are slow.

        Args:
            segment: Name of the segment.
            message: Message to publish.
            batched: Whether messages that follow at once may share a packet with it, even if it is an express message.
                A packet for each took half of the time of a trial with thousands of messages.
        """
        sent = message.sent(self.now(), _blocking(message.qos.priority, message.qos.express and not batched))
        self.bus.put(segment, sent)
        self.inputs.append(sent)


@functools.cache
def _blocking(priority: int, express: bool) -> Qos:  # noqa: FBT001 - a cached function
    return Qos(priority, "block", express)
