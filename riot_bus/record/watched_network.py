"""A network as one of its clients sees it, for the graph: sessions, announcements, and what is recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from riot_bus.record.subscriber import RecordingSubscriber
    from riot_bus.types.port import BridgedLink
    from riot_bus.zenoh import api as zenoh


class WatchedNetwork:
    """Implementation of `riot_bus.graph.observe.WatchedBus` for one client."""

    ids_ever: Collection[str] = ()
    intercepted: Collection[str] = ()
    bridged: Collection[BridgedLink] = ()
    services: Collection[str] = ()

    def __init__(self, session: zenoh.Session, subscribers: Callable[[], Sequence[RecordingSubscriber]]) -> None:
        self.sessions: Mapping[str, zenoh.Session] = {"": session}
        self.ids: Collection[str] = {str(session.info.zid())}
        self._subscribers = subscribers

    def flows(self) -> Mapping[tuple[str, str], int]:
        """Messages so far by key and segment."""
        return {(key, ""): count for each in self._subscribers() for key, count in each.flows.copy().items()}

    def senders(self) -> dict[tuple[str, str], set[str]]:
        """Ids in the stamps of messages, by key and segment."""
        return {(key, ""): zids for each in self._subscribers() for key, zids in each.senders().items()}
