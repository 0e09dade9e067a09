"""Stand-ins for the services of each segment in the other segments, which come and go with these services."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import TYPE_CHECKING, Any

from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.router.worker import Worker
    from riot_bus.zenoh import api as zenoh

_CACHED = 1 << 10  # each is a querier declared in a session, and callers may use ever new keys


class Presence:
    """Keeps the stand-ins for the services of one key expression.

    A stand-in is a queryable that the router declares on a segment while another segment has such a service: callers
    find it, and `take` gets their calls, to pass them on.

    The matching status of queriers that never ask tells which services exist. Zenoh tells it for single keys only: a
    querier with wildcards matches only services that include the whole expression. So expressions with wildcards
    always have stand-ins, which are complete only if a service is complete for the whole expression. Complete services
    (`served`) always have stand-ins, too, so that no call comes too early: their callers know from elsewhere which
    services exist. A call that finds no service ends at once.

    Args:
        served: Whether all services that the expression matches are complete.
    """

    def __init__(
        self,
        expression: str,
        sessions: Mapping[str, zenoh.Session],
        take: Mapping[str, Callable[[zenoh.Query], None]],
        *,
        served: bool,
        worker: Worker,
    ) -> None:
        self.expression = expression
        self._sessions, self._take, self._served, self._worker = sessions, take, served, worker
        self._wild = "*" in expression
        self._lock = threading.Lock()
        self._closed = False
        self._any: dict[str, Any] = {}
        self._complete: dict[str, Any] = {}
        self._listeners: list[Any] = []
        self._stand_ins: dict[str, tuple[bool, Any]] = {}
        self._by_key: OrderedDict[tuple[str, str, bool], Any] = OrderedDict()

    def open(self) -> None:
        """Start to watch for services."""
        if self._served:
            for name in self._sessions:
                self._stand_in(name, complete=True)
            return
        for name, session in self._sessions.items():
            self._complete[name] = silent_querier(session, self.expression, complete=True)
            if not self._wild:
                self._any[name] = silent_querier(session, self.expression, complete=False)
        for queriers in (self._any, self._complete):
            for name, querier in queriers.items():
                heard = _callback(self._sessions[name], self._changed)
                self._listeners.append(querier.declare_matching_listener(heard))
        self.update()

    def close(self) -> None:
        """End all stand-ins; safe to call twice."""
        with self._lock:
            self._closed = True
            stand_ins, self._stand_ins = self._stand_ins, {}
            others = [*self._listeners, *self._any.values(), *self._complete.values(), *self._by_key.values()]
            for each in (self._listeners, self._any, self._complete, self._by_key):
                each.clear()
        release(*(each for _, each in stand_ins.values()), *others)

    def asked(self, segment: str, key: str) -> dict[str, bool]:
        """Return the other segments that may have a service for a key, and whether to ask only complete ones."""
        others = [name for name in self._sessions if name != segment]
        if "*" in key:
            return dict.fromkeys(others, False)
        there = [name for name in others if self._there(name, key, complete=False)]
        return {name: self._served and self._there(name, key, complete=True) for name in there}

    def update(self) -> None:
        """Adapt the stand-ins to the services that exist now."""
        with self._lock:
            if self._closed or self._served:
                return
            there = {name for name, each in self._any.items() if each.matching_status.matching}
            complete = {name for name, each in self._complete.items() if each.matching_status.matching}
            for name in self._sessions:
                wanted = bool(complete - {name}) if self._wild or there - {name} else None
                present = self._stand_ins.get(name)
                if present is not None and present[0] is not wanted:
                    release(self._stand_ins.pop(name)[1])
                if wanted is not None and name not in self._stand_ins:
                    self._stand_in(name, complete=wanted)

    def _changed(self, status: object) -> None:
        self._worker.do(self.update)

    def _stand_in(self, name: str, *, complete: bool) -> None:
        session = self._sessions[name]
        pin(session, self.expression)
        queryable = session.declare_queryable(
            self.expression,
            _callback(session, self._take[name]),
            complete=complete,
            allowed_origin=library_of(session).Locality.REMOTE,  # else our own questions would come back
        )
        self._stand_ins[name] = (complete, queryable)

    def _there(self, name: str, key: str, *, complete: bool) -> bool:
        """Return whether a segment has a service for a key; caches recent queriers, which answer in microseconds."""
        with self._lock:
            if self._closed:
                return False
            querier = self._by_key.get((name, key, complete))
            if querier is None:
                querier = silent_querier(self._sessions[name], key, complete=complete)
                self._by_key[name, key, complete] = querier
                if len(self._by_key) > _CACHED:
                    release(self._by_key.popitem(last=False)[1])
            else:
                self._by_key.move_to_end((name, key, complete))
            return bool(querier.matching_status.matching)


def silent_querier(session: zenoh.Session, expression: str, *, complete: bool = False) -> Any:
    """Return a querier that never asks: its matching status tells whether others serve an expression."""
    zenoh = library_of(session)
    pin(session, expression)
    return session.declare_querier(
        expression,
        target=zenoh.QueryTarget.ALL_COMPLETE if complete else zenoh.QueryTarget.BEST_MATCHING,
        allowed_destination=zenoh.Locality.REMOTE,
    )


def _callback(session: zenoh.Session, function: Callable[[Any], None]) -> Any:
    return library_of(session).handlers.Callback(function, indirect=False)
