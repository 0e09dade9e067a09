"""Who talks to whom on a bus, from Zenoh's admin space; read only.

Ask only while components have settled. Zenoh 1.10.2 takes the read lock of its tables twice to answer, so a component
that declares something in between blocks both, and with them the whole router, for ever.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from collections.abc import Container

    import zenoh

    from riot_bus.bus.router import Bus

__all__ = ["Declared", "Kind", "declared", "graph"]

Kind = Literal["publisher", "subscriber", "queryable", "querier", "token"]


@dataclass(frozen=True, slots=True, order=True)
class Declared:
    """One thing that one session of a component declared on its segment.

    A component that puts without declaring a publisher does not show.
    """

    segment: str
    zid: str
    kind: Kind
    key: str


def graph(bus: Bus) -> list[Declared]:
    """Return what the components of all segments have declared, sorted; the bus's own sessions are left out."""
    found: set[Declared] = set()
    for name, session in bus.sessions.items():
        found.update(declared(session, name, ours=bus.ids))
    return sorted(found)


def declared(
    session: zenoh.Session, segment: str, *, kind: Kind | None = None, ours: Container[str] = ()
) -> list[Declared]:
    """Return what the components of one segment have declared.

    Args:
        session: The segment's own session.
        segment: Its name.
        kind: Only this kind.
        ours: Ids of sessions to leave out.
    """
    prefix = f"@/{session.info.zid()}/router/"
    result = []
    for each in get_args(Kind) if kind is None else (kind,):
        for reply in session.get(f"{prefix}{each}/**", timeout=5.0):
            if reply.ok is None:
                continue
            key = str(reply.ok.key_expr).removeprefix(f"{prefix}{each}/")
            sources = json.loads(reply.ok.payload.to_bytes())
            # `routers` names other segments and this one; sessions of this segment are peers or clients.
            zids = (*sources.get("peers", ()), *sources.get("clients", ()))
            result += [Declared(segment, zid, each, key) for zid in zids if zid not in ours]
    return result
