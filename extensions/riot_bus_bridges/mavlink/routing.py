"""Routing of frames as MAVLink routers do it, without sockets and clocks.

The rules are those of https://mavlink.io/en/guide/routing.html and of mavlink-router.
"""

from __future__ import annotations

import itertools
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Sequence
from typing import Generic, TypeVar

from riot_bus_bridges.mavlink.sequences import MOST_IDS
from riot_bus_bridges.mavlink.url import Filter
from riot_bus_mavlink.frame import HEADER_SIZE, Frame

Addressed = tuple[int, int]
"""Target system and target component; 0 stands for all, and for messages without a target."""


def addressed(frame: Frame, offsets: tuple[int | None, int | None]) -> Addressed:
    """Return the target of a frame.

    Args:
        offsets: Payload offsets of target system and target component in its type; None where there is none. Bytes cut
            off at the end of a payload are zero.
    """
    system, component = offsets
    if system is None:
        return 0, 0
    raw = frame.raw
    start = HEADER_SIZE[frame.version]
    end = start + raw[1]
    place = start + system
    target = raw[place] if place < end else 0
    if component is None or not target:
        return target, 0
    place = start + component
    return target, raw[place] if place < end else 0


class Peer:
    """Destination that frames are routed to: a link, or one of the clients of a server.

    Attributes:
        group: Parallel links of one group know the same systems and do not forward to each other; empty for none.
        hears_all: Whether it also gets frames addressed to others.
        counts: Numbers of frames by outcome: `in`, `filtered_in`, `filtered_out`, `duplicate`.
    """

    __slots__ = ("_accepts", "_emits", "_knowledge", "counts", "group", "hears_all", "link", "receives", "sends")

    def __init__(
        self,
        link: str,
        *,
        group: str = "",
        accepts: Filter | None = None,
        emits: Filter | None = None,
        receives: bool = True,
        sends: bool = True,
        hears_all: bool = False,
    ) -> None:
        self.link, self.group = link, group
        self.receives, self.sends, self.hears_all = receives, sends, hears_all
        self._accepts = None if accepts is None or accepts.is_open else accepts
        self._emits = None if emits is None or emits.is_open else emits
        self._knowledge = _Knowledge()
        self.counts: Counter[str] = Counter()

    @property
    def sources(self) -> frozenset[tuple[int, int]]:
        """Return the pairs of system and component seen on this peer and its group."""
        return frozenset((each >> 8, each & 255) for each in self._knowledge.sources.copy())

    def join(self, other: Peer) -> None:
        """Share the known sources with a peer of the same group."""
        other._knowledge.merge(self._knowledge)
        self._knowledge = other._knowledge


class _Knowledge:
    __slots__ = ("sources", "systems")

    def __init__(self) -> None:
        self.sources: set[int] = set()
        self.systems: set[int] = set()

    def learn(self, source: int) -> bool:
        """Add a source; return whether it is new."""
        if source in self.sources:
            return False
        self.sources.add(source)
        self.systems.add(source >> 8)
        return True

    def merge(self, other: _Knowledge) -> None:
        self.sources |= other.sources
        self.systems |= other.systems


class Duplicates:
    """Recognises frames, byte for byte, that were seen within a period.

    Each repetition restarts the period, as in mavlink-router. Since a frame contains its sequence number, its bytes
    recur after 256 frames of its source at the earliest, unless the source keeps sending one and the same frame.
    """

    def __init__(self, period: float, *, most: int = 1 << 16) -> None:  # 18 MB of frames
        self._period, self._most = period, most
        self._last: OrderedDict[bytes, float] = OrderedDict()

    def seen(self, raw: bytes, now: float) -> bool:
        """Return whether a frame was seen within the period; remember it."""
        last = self._last
        while last:
            oldest = next(iter(last))
            if now - last[oldest] < self._period and len(last) <= self._most:
                break
            del last[oldest]
        known = raw in last
        last[raw] = now
        last.move_to_end(raw)
        return known


PeerT = TypeVar("PeerT", bound=Peer)


class Routes(Generic[PeerT]):
    """The routing table of one segment.

    Not thread-safe, except that `deliver` may run concurrently with `receive`.

    Args:
        sniffer: A system that gets everything, on whatever link it is; -1 for none.

    Attributes:
        generation: Number that changes when frames may go to other peers than before.
    """

    def __init__(
        self,
        targets: Callable[[int], tuple[int | None, int | None]],
        *,
        duplicates: Duplicates | None = None,
        sniffer: int = -1,
    ) -> None:
        self._targets, self._duplicates, self._sniffer = targets, duplicates, sniffer
        self._generations = itertools.count()
        self.generation = next(self._generations)
        self._peers: tuple[PeerT, ...] = ()
        self._offsets: dict[int, tuple[int | None, int | None]] = {}

    @property
    def peers(self) -> Sequence[PeerT]:
        """Return the peers of the segment."""
        return self._peers

    def add(self, peer: PeerT) -> None:
        """Add a peer to the segment; it shares the known sources of its group, and routes found before are invalid."""
        if peer.group:
            mates = [each for each in self._peers if each.group == peer.group]
            if mates:
                peer.join(mates[0])
        self._peers = (*self._peers, peer)
        self.forget()

    def remove(self, peer: PeerT) -> None:
        """Forget a peer."""
        self._peers = tuple(each for each in self._peers if each is not peer)
        self.forget()

    def forget(self) -> None:
        """Start a new generation: routes found before are no longer valid."""
        self.generation = next(self._generations)

    def settled(self, message_id: int) -> bool:
        """Return whether all frames of this type from one source take the same route until the generation changes."""
        offsets = self._offsets.get(message_id) or self._targets(message_id)
        return self._duplicates is None and offsets[0] is None and all(each._emits is None for each in self._peers)

    def knows(self, system: int, component: int) -> bool:
        """Return whether a source was seen on any link."""
        source = system << 8 | component
        return any(source in each._knowledge.sources for each in self._peers)

    def receive(self, frame: Frame, origin: PeerT, now: float) -> list[PeerT] | None:
        """Take a frame that came over a link; learn where its source is.

        Returns:
            The other peers on this segment that get it; None if it is dropped, here and elsewhere.
        """
        counts = origin.counts
        system, component, message_id = frame.system, frame.component, frame.message_id
        if not origin.receives or (
            origin._accepts is not None and not origin._accepts.passes(message_id, system, component)
        ):
            counts["filtered_in"] += 1
            return None
        source = system << 8 | component
        if origin._knowledge.learn(source):
            self.forget()
        if self._duplicates is not None and self._duplicates.seen(frame.raw, now):
            counts["duplicate"] += 1
            return None
        counts["in"] += 1
        peers = self._peers
        if len(peers) == 1:
            return []
        group = origin.group
        others = [each for each in peers if each is not origin and (not group or each.group != group)]
        return self._receivers(frame, others, source)

    def deliver(self, frame: Frame, *, looped: bool) -> list[PeerT]:
        """Return the peers that get a frame from the bus.

        Args:
            looped: Whether it came over a link of this bridge; if so, it is not sent to the peers of its source.
        """
        return self._receivers(frame, self._peers, frame.system << 8 | frame.component if looped else -1)

    def _receivers(self, frame: Frame, peers: Iterable[PeerT], source: int) -> list[PeerT]:
        message_id = frame.message_id
        offsets = self._offsets.get(message_id)
        if offsets is None:
            offsets = self._targets(message_id)
            if len(self._offsets) < MOST_IDS:
                self._offsets[message_id] = offsets
        system, component = (0, 0) if offsets[0] is None else addressed(frame, offsets)
        found = []
        for each in peers:
            known = each._knowledge
            if not each.sends or source in known.sources:
                continue
            if system and not each.hears_all and self._sniffer not in known.systems:
                seen = (system << 8 | component) in known.sources if component else system in known.systems
                if not seen:
                    continue
            if each._emits is not None and not each._emits.passes(message_id, frame.system, frame.component):
                each.counts["filtered_out"] += 1
                continue
            found.append(each)
        return found
