"""Reports of all sources of a graph at one moment."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from riot_bus.graph.processes import SocketOwner
    from riot_bus.types.capabilities import Announcement
    from riot_bus.types.port import BridgedLink


@dataclass(frozen=True, slots=True)
class Observations:
    """Reports of the sources at one moment.

    Attributes:
        sessions: Mode of each connected session by segment and id, without the bus's own.
        addresses: These sessions' ends of the links, by segment and id.
        owners: Processes by address.
        names: Names by session id.
        flows: Messages so far by key and source segment.
        rates: Recent messages per second, by key and source segment.
        senders: Ids that stamped these messages, by key and source segment.
        matching: Segments and keys for which there is a receiver.
        bridged: Links of a bridge in the router's own process.
        intercepted: Whether messages on a key go through the pipeline, so that matching is known by segment.
        calls_intercepted: Whether requests and replies of a service go through the pipeline.
        name: Function that returns the name of a key for people.
        skipped: Number of keys whose matching is not watched, because there are too many.
        left_out: Whether keys with less traffic were left out.
    """

    segments: tuple[str, ...] = ()
    sessions: Mapping[tuple[str, str], str] = field(default_factory=dict)
    addresses: Mapping[tuple[str, str], Collection[str]] = field(default_factory=dict)
    owners: Mapping[str, SocketOwner] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)
    tokens: Collection[Announcement] = ()
    flows: Mapping[tuple[str, str], int] = field(default_factory=dict)
    rates: Mapping[tuple[str, str], float] = field(default_factory=dict)
    senders: Mapping[tuple[str, str], Collection[str]] = field(default_factory=dict)
    matching: Collection[tuple[str, str]] = ()
    bridged: Collection[BridgedLink] = ()
    intercepted: Callable[[str], bool] = lambda _: False
    calls_intercepted: Callable[[str], bool] = lambda _: False
    name: Callable[[str], str] = str
    skipped: int = 0
    left_out: bool = False
