"""The keys that the junction cuts: forwarders of messages, stand-ins for services, and what is counted of both."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import TYPE_CHECKING, Protocol, TypeVar

from riot_bus.router.advanced.publisher_proxies import PublisherProxies
from riot_bus.router.forwarder import Forwarder
from riot_bus.router.services.services import Services
from riot_bus.zenoh.convert import Claims
from riot_bus.zenoh.session import includes, intersects

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from riot_bus.router.delivery_queue import DeliveryQueue
    from riot_bus.zenoh.network import Network


class MessageSource(Protocol):
    """What brings messages of a segment: a `Forwarder`, or the path of a bridge in this process."""

    segment: str

    def passed(self) -> Counter[str]:
        """Return how many messages per key were forwarded without inspection."""
        ...

    def flows(self) -> Counter[str]:
        """Return how many intercepted messages per key were received."""
        ...

    def forget(self) -> None:
        """Forget what is known of keys, since interceptors, recorder or claims have changed."""

    def idle(self) -> bool:
        """Return whether no message is in process."""
        ...

    def close(self) -> None:
        """Forward the messages received so far, then end; safe to call twice."""


SourceT = TypeVar("SourceT", bound=MessageSource)


class CutKeys:
    """Cuts keys out of what the junction joins, and forwards their messages and calls through the pipeline.

    Args:
        joined: Function that is called whenever the junction joins the segments anew.

    Attributes:
        services: Canonical key expressions of services whose calls are intercepted.
    """

    def __init__(
        self,
        network: Network,
        deliveries: DeliveryQueue,
        *,
        topic: Callable[[str], str],
        joined: Callable[[], None],
    ) -> None:
        self.services: list[str] = []
        self._network, self._deliveries, self._topic, self._joined = network, deliveries, topic, joined
        self._present: dict[str, list[Forwarder]] = {}
        self._retired: list[Forwarder] = []
        self._inner: list[MessageSource] = []
        self._advanced: PublisherProxies | None = None
        self._calls: Services | None = None

    def open(self, *, spaces: Sequence[str]) -> None:
        """Get ready to cut keys, if there is more than one segment.

        Args:
            spaces: Key expressions of complete services (`HasServices.services`).
        """
        if len(self._network.segments) > 1:
            self._advanced = PublisherProxies(self._deliveries, changed=self.forget, fence=self._fence)
            self._deliveries.surround(stream_of=self._advanced.state_of)
            self._calls = Services(self._deliveries, spaces=spaces)

    def close_inner(self) -> None:
        """Forward what this process has put so far."""
        for source in self._inner:
            source.close()

    def close(self) -> None:
        """Forward what has come so far, then end; safe to call twice."""
        if self._calls is not None:
            self._calls.close()
        for expression in list(self._present):
            self._retire(expression)
        if self._advanced is not None:
            self._advanced.close()

    def attach(self, make: Callable[[DeliveryQueue, PublisherProxies | None], SourceT]) -> SourceT:
        """Make and return a source of messages of this process; see `Bus.attach`."""
        source = make(self._deliveries, self._advanced)
        self._inner.append(source)
        return source

    def cut(self, expressions: list[str], services: list[str], *, again: bool) -> None:
        """Cut these; forwarders stay as long as they may have messages, since a new one would start with a gap.

        Args:
            expressions: Canonical key expressions of messages.
            services: Canonical key expressions of services.
            again: Whether messages of further keys crossed natively until now.
        """
        junction = self._network.junction
        if junction is not None:
            junction.settle()  # while everything still crosses
        kept = [text for text in self._present if any(intersects(each, text) for each in expressions)]
        new = [text for text in expressions if not any(includes(each, text) for each in kept)]
        former = self._deliveries.surroundings.claims
        self._deliveries.surround(
            claims=Claims(expressions, owners=kept, within=former)
        )  # intercepted before and after
        self.forget()
        for expression in self._present.keys() - set(kept):
            self._retire(expression)
        self._watch_advanced(expressions, within=True, again=again)
        if self._calls is not None:
            self._calls.retire(services)
        if junction is not None:
            junction.open(expressions, services)
        self.services = services
        if self._calls is not None:
            self._calls.select(services)
        self._deliveries.surround(claims=Claims(expressions, owners=[*kept, *new]))
        for text in new:
            self._present[text] = [
                Forwarder(name, text, self._deliveries, self._advanced) for name in self._network.segments
            ]
        self.forget()
        self._joined()
        self._watch_advanced(expressions, within=False, again=again)

    def _watch_advanced(self, expressions: list[str], *, within: bool, again: bool) -> None:
        """Watch these expressions; `within` limits it to those that both the former and the next junction cut."""
        if self._advanced is None:
            return
        former = self._advanced.watched
        for text in expressions:
            if text not in former and (not within or any(includes(each, text) for each in former)):
                self._advanced.watch(text, again=again)
        for text in former:
            if text not in expressions and not (within and any(includes(each, text) for each in expressions)):
                self._advanced.unwatch(text)

    def _retire(self, expression: str) -> None:
        for forwarder in self._present.pop(expression):
            forwarder.close()
            if forwarder.received or forwarder.shed:  # else each change would make counting slower
                self._retired.append(forwarder)

    def _fence(self, segment: str) -> Callable[[], bool]:
        """Return a test, to be asked twice, whether forwarders have taken all messages of a segment up to now."""
        fences = [forwarder.fence() for forwarder in self.forwarders() if forwarder.segment == segment]
        return lambda: all(fence() for fence in fences)

    def forget(self) -> None:
        """Let forwarders ask again what becomes of each key; this waits for nothing."""
        for source in self._sources():
            source.forget()

    def idle(self) -> bool:
        """Return whether no received message is in process."""
        return (
            all(source.idle() for source in self._sources())
            and (self._advanced is None or self._advanced.idle())
            and (self._calls is None or self._calls.idle())
        )

    # -- what happened ------------------------------------------------------------------------------------------------

    def forwarders(self) -> list[Forwarder]:
        """Return the present and former forwarders; former ones are kept for their counts."""
        return [*self._retired, *self._working()]

    def received(self) -> int:
        """Return the number of messages that present forwarders have received."""
        return sum(forwarder.received for forwarder in self._working())

    def passed(self) -> Counter[str]:
        """Return, by topic, how many messages were forwarded without inspection."""
        return self._by_topic(source.passed() for source in [*self.forwarders(), *self._inner])

    def held(self) -> Counter[str]:
        """Return, by topic, how many messages wait for a history, and calls until they are due."""
        return self._by_topic(each.held() for each in (self._advanced, self._calls) if each is not None)

    def shed(self) -> Counter[str]:
        """Return, by topic, for how many messages, requests and replies there was no room."""
        calls = [] if self._calls is None else self._calls.shed()
        return self._by_topic([*(forwarder.shed for forwarder in self.forwarders()), *calls])

    def flows(self) -> dict[tuple[str, str], int]:
        """Return the number of messages received so far, by key and source segment."""
        total: Counter[tuple[str, str]] = Counter()
        for source in [*self.forwarders(), *self._inner]:
            for key, number in source.flows().items():
                total[key, source.segment] += number
        return dict(total)

    def senders(self, ours: set[str]) -> dict[tuple[str, str], set[str]]:
        """Return the ids in messages' timestamps except ours, by key and segment."""
        found: dict[tuple[str, str], set[str]] = {}
        for forwarder in self.forwarders():
            for key, zids in forwarder.senders().items():
                found.setdefault((key, forwarder.segment), set()).update(zids - ours)
        return found

    def _working(self) -> list[Forwarder]:
        return list(itertools.chain(*list(self._present.values())))

    def _sources(self) -> list[MessageSource]:
        return [*self._working(), *self._inner]

    def _by_topic(self, parts: Iterable[Mapping[str, int]]) -> Counter[str]:
        total: Counter[str] = Counter()
        for part in parts:
            for key, number in dict(part).items():
                total[self._topic(key)] += number
        return total
