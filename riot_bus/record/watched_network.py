"""A network as one of its clients sees it, for the graph: sessions, announcements, and what is recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from riot_bus.record.subscriber import RecordingSubscriber
    from riot_bus.types.bridging import BridgedLink
    from riot_bus.zenoh import api as zenoh

__all__ = ["WatchedNetwork"]


class WatchedNetwork:
    """Implementation of `riot_bus.graph.observe.WatchedBus` for one client.

    Args:
        session: Session of the client.
        intakes: Function that returns the subscribers.
    """

    def __init__(self, session: zenoh.Session, intakes: Callable[[], Sequence[RecordingSubscriber]]) -> None:
        self._session, self._intakes = session, intakes
        self._zid = str(session.info.zid())

    @property
    def sessions(self) -> Mapping[str, zenoh.Session]:
        """The only session."""
        return {"": self._session}

    @property
    def ids(self) -> Collection[str]:
        """Id of the only session."""
        return {self._zid}

    @property
    def ids_ever(self) -> Collection[str]:
        """No further ids."""
        return ()

    @property
    def intercepted(self) -> Collection[str]:
        """Nothing: a client intercepts no keys."""
        return ()

    @property
    def bridged(self) -> Collection[BridgedLink]:
        """No bridged links."""
        return ()

    @property
    def services(self) -> Collection[str]:
        """No services."""
        return ()

    def flows(self) -> Mapping[tuple[str, str], int]:
        """Messages so far by key and segment."""
        return {(key, ""): count for each in self._intakes() for key, count in each.flows.copy().items()}

    def senders(self) -> dict[tuple[str, str], set[str]]:
        """Ids in the stamps of messages, by key and segment."""
        return {(key, ""): zids for each in self._intakes() for key, zids in each.senders().items()}
