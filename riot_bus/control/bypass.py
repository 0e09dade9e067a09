"""The alarm for ways around the router: looks for them, cheaply and without harm, and says which setting cures them."""

from __future__ import annotations

import itertools
import logging
import os
import threading
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Self

from riot_bus.control.reach import Bypass, Contact, Sightings, judge
from riot_bus.graph.model import ConnectedComponent
from riot_bus.graph.processes import connections, owners
from riot_bus.graph.sources import AdminView, admin_views
from riot_bus.zenoh.scouting import THIS_HOST, scout

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from riot_bus.graph.observe import WatchedBus
    from riot_bus.zenoh.scouting import Answer, Scouting

_LOG = logging.getLogger(__name__)


def find_bypasses(bus: WatchedBus, answers: Mapping[str, Answer]) -> list[Bypass]:
    """Return all ways by which components of different segments of a bus reach each other around the router.

    They show by sessions in two segments; links that a component or foreign router with an enabled admin space reports
    about itself; TCP connections between components' processes on this host; and answers to multicast scouting.
    """
    ours = {*bus.ids, *bus.ids_ever}
    views: dict[str, AdminView] = {}
    for session in bus.sessions.values():
        views.update(admin_views(session))
    components = _components(bus, ours, views)
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
    return judge(Sightings(components, sorted({*contacts, *_tcp(components)}), others, answers))


def _components(bus: WatchedBus, ours: Collection[str], views: Mapping[str, AdminView]) -> list[ConnectedComponent]:
    found = []
    for segment, session in bus.sessions.items():
        ends: dict[str, list[str]] = {}
        for link in session.info.links():
            ends.setdefault(str(link.zid), []).append(link.dst)
        for zid, mode in sorted({(str(each.zid), str(each.whatami)) for each in session.info.transports()}):
            if zid not in ours:
                name, addresses = views[zid].name if zid in views else "", tuple(sorted(ends.get(zid, ())))
                found.append(ConnectedComponent(segment, zid, mode, name, (), addresses))
    processes = owners({address for each in found for address in each.addresses})
    for place, each in enumerate(found):
        owner = next((processes[address] for address in each.addresses if address in processes), None)
        if owner is not None:
            found[place] = replace(each, pid=owner.pid, command=owner.command)
    return sorted(found, key=lambda each: (each.segment, each.zid))


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
        self._bus, self._callback, self._period, self._scouting = bus, callback, period, scouting
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="riot-bypass", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        answers: Mapping[str, Answer] = {}
        for number in itertools.count():
            try:
                if self._scouting is not None and number % 6 == 0:
                    answers = scout(self._scouting)
                found = find_bypasses(self._bus, answers)
                if found != self.bypasses:
                    self.bypasses = found
                    self._callback(found)
            except Exception:
                if not self._stopping.is_set():
                    _LOG.exception("looking for ways around the router failed")
            if self._stopping.wait(self._period):
                return
