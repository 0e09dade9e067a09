"""A snapshot of what plain Zenoh components have declared: dangerous, and therefore only taken on request."""

from __future__ import annotations

import json
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.keyexpr_pins import no_more_numbers

if TYPE_CHECKING:
    from collections.abc import Container, Mapping

    from riot_bus.zenoh import api as zenoh

__all__ = ["Declared", "Kind", "declarations"]

Kind = Literal["publisher", "subscriber", "queryable", "querier"]


@dataclass(frozen=True, slots=True, order=True)
class Declared:
    """One thing that a component declared on its segment."""

    segment: str
    zid: str
    kind: Kind
    key: str


def declarations(
    sessions: Mapping[str, zenoh.Session], *, ours: Container[str] = (), timeout: float = 5.0
) -> list[Declared]:
    """Return what the components of all segments have declared, sorted.

    Risk: this can hang a segment for ever. To answer, Zenoh 1.10 takes the read lock of its tables and, still holding
    it, takes it again to send each reply (`resources_data` and `route_send_response` in its sources). If a component
    declares or undeclares anything between the two, the writer waits for the first and the second waits for the
    writer. Three clients that declared all the time hung a router at the second query. There is no cure but to
    restart the bus. Ask only when no component starts, stops or changes subscriptions, and no messages come on new
    keys; never on a live system.

    Args:
        sessions: Segments' own sessions by name.
        ours: Ids of sessions to leave out.
        timeout: Seconds until a router that does not answer counts as hung.

    Raises:
        EnvironmentFaultError: A router does not answer any more.
    """
    found: set[Declared] = set()
    for name, session in sessions.items():
        # A hung router never answers, not even by a timeout of Zenoh's: ask on a thread that may be abandoned.
        asking = threading.Thread(target=lambda s=session, n=name: found.update(_ask(s, n, ours)), daemon=True)
        with no_more_numbers():
            asking.start()
            asking.join(timeout)
        if asking.is_alive():
            raise EnvironmentFaultError(
                "the router hangs: a component declared something while declarations were read",
                where=f"segment {name!r}",
                hint="restart the bus, and do without declarations",
            )
    return sorted(found)


def _ask(session: zenoh.Session, segment: str, ours: Container[str]) -> list[Declared]:
    result = []
    for kind in get_args(Kind):
        prefix = f"@/{session.info.zid()}/router/{kind}/"
        for reply in session.get(f"{prefix}**", timeout=2.0):
            if reply.ok is not None:
                key = str(reply.ok.key_expr).removeprefix(prefix)
                sources = json.loads(reply.ok.payload.to_bytes())
                # `routers` names other segments and this one; sessions of this segment are peers or clients.
                zids = (*sources.get("peers", ()), *sources.get("clients", ()))
                result += [Declared(segment, zid, kind, key) for zid in zids if zid not in ours]
    return result
