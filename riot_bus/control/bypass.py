"""The alarm for ways around the router: looks for them, cheaply and without harm, and says which setting cures them."""

from __future__ import annotations

import itertools
import logging
import os
import threading
from collections import Counter
from typing import TYPE_CHECKING, Self

from riot_bus.control.reach import Bypass, Contact, Sightings, judge
from riot_bus.graph.model import ConnectedComponent
from riot_bus.graph.processes import SocketOwner, connections, owners
from riot_bus.graph.sources import AdminView, admin_views
from riot_bus.zenoh.scouting import THIS_HOST, scout

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from riot_bus.graph.observe import WatchedBus
    from riot_bus.zenoh.scouting import Answer, Scouting

_LOG = logging.getLogger(__name__)


class BypassFinder:
    """Looks for components of different segments that reach each other around the router.

    It sees sessions in two segments; links that a component or foreign router with an enabled admin space reports about
    itself; TCP connections between components' processes on this host; and answers to multicast scouting. It remembers
    which process owns which link.
    """

    def __init__(self, bus: WatchedBus) -> None:
        self._bus = bus
        self._owners: dict[str, SocketOwner | None] = {}
        self._answers: Mapping[str, Answer] = {}

    def look(self, scouting: Scouting | None) -> list[Bypass]:
        """Return all ways around the router; without `scouting`, the last answers to multicast scouting count."""
        return judge(self.sightings(scouting))

    def sightings(self, scouting: Scouting | None) -> Sightings:
        """Return what can be seen now."""
        ours = {*self._bus.ids, *self._bus.ids_ever}
        views: dict[str, AdminView] = {}
        for session in self._bus.sessions.values():
            views.update(admin_views(session))
        components = self._components(ours, views)
        if scouting is not None:
            self._answers = scout(scouting)
        known = {each.zid for each in components}
        contacts = {
            Contact(min(zid, other), max(zid, other), "its admin space says so")
            for zid, view in views.items()
            for other in view.sessions
            if not {zid, other} & ours
        }
        modes = {zid: view.mode for zid, view in views.items()}
        for view in views.values():
            modes.update(view.sessions)
        others = {
            zid: ConnectedComponent("", zid, mode, views[zid].name if zid in views else "")
            for zid, mode in modes.items()
            if zid not in known | ours
        }
        return Sightings(components, sorted({*contacts, *_tcp(components)}), others, self._answers)

    def _components(self, ours: Collection[str], views: Mapping[str, AdminView]) -> list[ConnectedComponent]:
        found: dict[tuple[str, str], ConnectedComponent] = {}
        for segment, session in self._bus.sessions.items():
            ends: dict[str, list[str]] = {}
            for link in session.info.links():
                ends.setdefault(str(link.zid), []).append(link.dst)
            for transport in session.info.transports():
                zid = str(transport.zid)
                if zid not in ours:
                    name = views[zid].name if zid in views else ""
                    addresses = tuple(sorted(ends.get(zid, ())))
                    found[segment, zid] = ConnectedComponent(segment, zid, str(transport.whatami), name, (), addresses)
        self._learn({address for each in found.values() for address in each.addresses})
        return [self._owned(each) for _, each in sorted(found.items())]

    def _learn(self, addresses: set[str]) -> None:
        self._owners = {each: owner for each, owner in self._owners.items() if each in addresses}
        new = addresses - self._owners.keys()
        found = owners(new) if new else {}
        self._owners.update({each: found.get(each) for each in new})

    def _owned(self, one: ConnectedComponent) -> ConnectedComponent:
        owner = next(filter(None, (self._owners.get(each) for each in one.addresses)), None)
        if owner is None:
            return one
        return ConnectedComponent(one.segment, one.zid, one.mode, one.name, (), one.addresses, owner.pid, owner.command)


def _tcp(components: list[ConnectedComponent]) -> list[Contact]:
    """Return the TCP connections between processes that hold one component each; the bus's own process is left out."""
    sessions = {each.pid: each.zid for each in components if each.pid not in (None, os.getpid())}
    many = Counter(pid for pid, _ in {(each.pid, each.zid) for each in components})
    alone = {pid: zid for pid, zid in sessions.items() if pid is not None and many[pid] == 1}
    if len(alone) < 2:
        return []
    ends = {(each.near, each.far): each.pid for each in connections(alone.keys())}
    contacts = []
    for (near, far), pid in ends.items():
        other = ends.get((far, near))
        if other is not None and pid < other:
            how = f"TCP connection between processes {pid} and {other} ({near[0]}:{near[1]} and {far[0]}:{far[1]})"
            one, two = sorted((alone[pid], alone[other]))
            contacts.append(Contact(one, two, how))
    return contacts


class BypassWatch:
    """Looks periodically, and calls back when a way around the router opens or closes; a context manager.

    Args:
        callback: Called with all present bypasses whenever they have changed; what it raises is logged.
        period: Seconds between two looks.
        scouting: Settings for asking who answers multicast scouting; None not to ask.
    """

    def __init__(
        self,
        bus: WatchedBus,
        callback: Callable[[list[Bypass]], None],
        *,
        period: float = 5.0,
        scouting: Scouting | None = THIS_HOST,
    ) -> None:
        self.bypasses: list[Bypass] = []
        """Bypasses found by the last look."""
        self._finder = BypassFinder(bus)
        self._callback = callback
        self._period = period
        self._scouting = scouting
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="riot-bypass", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        for number in itertools.count():
            try:
                found = self._finder.look(self._scouting if number % 6 == 0 else None)
                if found != self.bypasses:
                    self.bypasses = found
                    self._callback(found)
            except Exception:
                if not self._stopping.is_set():
                    _LOG.exception("looking for ways around the router failed")
            if self._stopping.wait(self._period):
                return
