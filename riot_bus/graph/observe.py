"""Observer that gathers the reports of all sources of a bus, with the state to keep in between."""

from __future__ import annotations

import heapq
import time
from typing import TYPE_CHECKING, Protocol

from riot_bus.graph.observations import Observations
from riot_bus.graph.processes import owners
from riot_bus.graph.sources import SegmentSource, admin_views
from riot_bus.vocabulary.selector import key_matches
from riot_bus.zenoh.convert import FEW
from riot_bus.zenoh.session_config import is_control

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from riot_bus.graph.processes import SocketOwner
    from riot_bus.types.port import BridgedLink
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.zenoh import api as zenoh

_MOST_WATCHED = 2_000  # over all segments; each one slows publishing on undeclared keys (see `_watch`)
_MOST_SELDOM = _MOST_WATCHED // 10  # components may make up any number of such keys
_MOST_QUESTIONS = 5  # each asks all segments; at one look a second, names may come 5 s late
_MOST_FLOWS = _MOST_WATCHED  # beyond it, a graph of made-up keys would exhaust memory
_LEAST_RATE_S = 0.1  # looks may be 20 ms apart (`watch._LEAST_S`): one message would then look like 50 a second

Key = tuple[str, str]


class WatchedBus(Protocol):
    """Interface of a bus that a graph needs."""

    @property
    def sessions(self) -> Mapping[str, zenoh.Session]:
        """The segments' own sessions."""

    @property
    def ids(self) -> Collection[str]:
        """Ids of the bus's current sessions."""

    @property
    def ids_ever(self) -> Collection[str]:
        """Ids of all routers that were ever the junction."""

    @property
    def intercepted(self) -> Collection[str]:
        """The key expressions that are intercepted."""

    @property
    def bridged(self) -> Collection[BridgedLink]:
        """Links of a bridge in this process."""

    @property
    def services(self) -> Collection[str]:
        """The key expressions of services whose requests and replies are intercepted."""

    def flows(self) -> Mapping[tuple[str, str], int]:
        """Messages so far by key and source segment."""


class Observer:
    """Observer of a bus.

    Args:
        changed: Called after each Zenoh event.
        senders: Returns the ids that stamped messages, by key and source segment.
        processes: Whether to look for the components' processes on this host.
    """

    def __init__(
        self,
        bus: WatchedBus,
        changed: Callable[[], None],
        *,
        senders: Callable[[], Mapping[Key, Collection[str]]],
        registry: TypeRegistry,
        processes: bool,
    ) -> None:
        self._bus = bus
        self._sources = {
            segment: SegmentSource(session, registry, changed) for segment, session in bus.sessions.items()
        }
        self._senders = senders
        self._name = registry.topic
        self._processes = processes
        self._flows: dict[Key, int] = {}
        self._left_out = False
        self._looked = time.monotonic()
        self._rates: dict[Key, float] = {}
        self._owners: dict[str, SocketOwner | None] = {}
        self._names: dict[str, str] = {}
        self._questions: dict[str, int] = {}
        self._watched: set[str] = set()

    def start(self) -> None:
        """Listen to all segments."""
        for source in self._sources.values():
            source.start()

    def stop(self) -> None:
        """Stop listening; safe to call twice."""
        for source in self._sources.values():
            source.stop()

    def observe(self) -> Observations:
        """Return what all sources report now."""
        ours = {*self._bus.ids, *self._bus.ids_ever}
        modes = {
            (segment, zid): mode
            for segment, source in self._sources.items()
            for zid, mode in source.modes().items()
            if zid not in ours and not is_control(zid)
        }
        ends = {(s, z): found for s, each in self._sources.items() for z, found in each.addresses().items()}
        addresses = {who: found for who, found in ends.items() if who in modes}
        tokens = {token for each in self._sources.values() for token in each.tokens() if token.zid not in ours}
        self._measure(self._busiest(self._bus.flows()))
        keys = {key for (key, _), count in self._flows.items() if count > FEW}
        keys |= {token.key for token in tokens if token.role == "publishes"}
        skipped = self._watch(keys, _MOST_WATCHED) + self._watch({key for key, _ in self._flows} - keys, _MOST_SELDOM)
        return Observations(
            segments=tuple(self._sources),
            sessions=modes,
            addresses=addresses,
            owners=self._find_owners({address for found in addresses.values() for address in found}),
            names=self._find_names({zid for _, zid in modes}),
            tokens=tokens,
            flows=self._flows,
            rates=self._rates,
            senders=self._senders(),
            matching={(segment, key) for segment, each in self._sources.items() for key in each.matching()},
            bridged=self._bus.bridged,
            intercepted=_any_of(self._bus.intercepted),
            calls_intercepted=_any_of(self._bus.services),
            name=self._name,
            skipped=skipped,
            left_out=self._left_out,
        )

    def _busiest(self, flows: Mapping[Key, int]) -> dict[Key, int]:
        """Return only the busiest keys: a graph of all keys that a component may invent would exhaust memory."""
        self._left_out = len(flows) > _MOST_FLOWS
        if not self._left_out:
            return dict(flows)
        shown = self._flows  # these stay if others have as many messages, else the graph would change all the time
        return dict(heapq.nlargest(_MOST_FLOWS, flows.items(), key=lambda each: (each[1], each[0] in shown)))

    def _measure(self, flows: dict[Key, int]) -> None:
        now = time.monotonic()
        seconds = now - self._looked
        if seconds >= _LEAST_RATE_S:
            self._rates = {each: (count - self._flows.get(each, 0)) / seconds for each, count in flows.items()}
            self._looked, self._flows = now, flows
        else:  # too soon for a rate, but what is new must show at once
            self._flows = {**flows, **{each: count for each, count in self._flows.items() if each in flows}}

    def _watch(self, keys: set[str], most: int) -> int:
        """Watch whether these keys have receivers, up to `most` watches; return how many keys are too many.

        Each watch has a cost: publishing on an undeclared key takes Zenoh longer, the more keys are declared beside it.
        """
        new = sorted(key for key in keys - self._watched if key and "*" not in key)
        room = max(0, most // max(1, len(self._sources)) - len(self._watched))
        for source in self._sources.values():
            source.watch_matching(new[:room])
        self._watched.update(new[:room])
        return len(new[room:])

    def _find_owners(self, addresses: set[str]) -> dict[str, SocketOwner]:
        if not self._processes:
            return {}
        self._owners = {each: owner for each, owner in self._owners.items() if each in addresses}
        new = addresses - self._owners.keys()
        if new:
            found = owners(new)
            self._owners.update({each: found.get(each) for each in new})
        return {each: owner for each, owner in self._owners.items() if owner is not None}

    def _find_names(self, zids: set[str]) -> dict[str, str]:
        """Ask newcomers for their names; a few times, as their admin space may come up after their link."""
        self._questions = {zid: self._questions.get(zid, 0) for zid in zids}
        new = [zid for zid in zids if zid not in self._names and self._questions[zid] < _MOST_QUESTIONS]
        if new:
            self._names = {zid: name for zid, name in self._names.items() if zid in zids}  # who has gone is forgotten
            # Every segment is asked: the junction may be away just now.
            for source in self._sources.values():
                self._names.update({zid: view.name for zid, view in admin_views(source.session).items()})
            for zid in new:
                self._questions[zid] += 1
        return {zid: name for zid, name in self._names.items() if name}


def _any_of(expressions: Collection[str]) -> Callable[[str], bool]:
    present = list(expressions)
    return lambda key: any(key_matches(expression, key) for expression in present)
