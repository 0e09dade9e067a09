"""Segments that stay open between trials: opening, joining and closing them took a third of a short trial."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import canonical, release, wait_until

if TYPE_CHECKING:
    from collections.abc import Sequence

    import zenoh

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
            anywhere = dict.fromkeys(segments, ("tcp/127.0.0.1:0",))
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
