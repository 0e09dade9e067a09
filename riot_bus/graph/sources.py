"""Sources of the graph: what one segment's session sees, without any query that could harm its router.

Queries that are safe with Zenoh 1.10.2, by its source code and by trials while three clients declared and undeclared
without a pause: transports, links and their events take no lock of the routing tables (1,100,000 queries). The root
keys `@/<id>/<mode>`, the only ones that match `@/*/*`, release that lock before they reply (132,000 and 8,000 queries).
All keys below them except `metrics` and `route/successor/**` reply while they hold it (`subscriber/**`, `publisher/**`,
`queryable/**`, `querier/**`, `token/**`, `linkstate/*`): the router hung forever at the second query.
"""

from __future__ import annotations

import json
import threading
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from riot_bus.graph.tokens import expressions, parse_token
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from riot_bus.types.capabilities import Announcement
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.zenoh import api as zenoh


@dataclass(frozen=True, slots=True)
class AdminView:
    """What a session with an enabled admin space says about itself.

    Attributes:
        mode: `client`, `peer` or `router`.
        name: `metadata.name` of its configuration.
        locators: Locators that it listens on.
        sessions: Ids and modes of the sessions that it is connected to.
        links: Id of the session at the other end of each link, by the locators of both ends, the other one first.
    """

    zid: str
    mode: str
    name: str = ""
    locators: tuple[str, ...] = ()
    sessions: dict[str, str] = field(default_factory=dict)
    links: dict[tuple[str, str], str] = field(default_factory=dict)

    @classmethod
    def parse(cls, key: str, payload: bytes) -> AdminView | None:
        """Parse a reply to `@/*/*`; None if it is something else, since anything in the network may reply."""
        chunks = key.split("/")
        try:
            found = json.loads(payload)
            if len(chunks) != 3 or found["zid"] != chunks[1]:
                return None
            metadata, sessions = found.get("metadata"), found.get("sessions", ())
            name = metadata.get("name") if isinstance(metadata, dict) else None
            return cls(
                zid=chunks[1],
                mode=chunks[2],
                name=name if isinstance(name, str) else "",
                locators=tuple(str(each) for each in found.get("locators", ())),
                sessions={str(each["peer"]): str(each["whatami"]) for each in sessions},
                links={
                    (str(link["dst"]), str(link["src"])): str(each["peer"])
                    for each in sessions
                    for link in each.get("links", ())
                },
            )
        except (ValueError, TypeError, KeyError, AttributeError):
            return None


def admin_views(session: zenoh.Session) -> dict[str, AdminView]:
    """Return the views of all sessions that a segment's own session reaches and whose admin space is enabled, by id."""
    zenoh = library_of(session)
    every, now = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
    replies = session.get("@/*/*", timeout=1.0, target=every, consolidation=now)  # a hung session must not block a look
    views = {}
    for reply in replies:
        view = AdminView.parse(str(reply.ok.key_expr), reply.ok.payload.to_bytes()) if reply.ok is not None else None
        if view is not None:
            views[view.zid] = view
    return views


class SegmentSource:
    """What a segment's session sees, kept up to date by events: sessions, links and announcements.

    Args:
        changed: Called on a Zenoh thread after each event; must return at once.
    """

    def __init__(self, session: zenoh.Session, registry: TypeRegistry, changed: Callable[[], None]) -> None:
        self.session = session
        self._registry = registry
        self.zid = str(session.info.zid())
        self._changed = changed
        self._lock = threading.Lock()
        self._modes: dict[str, str] = {}
        self._addresses: defaultdict[str, set[str]] = defaultdict(set)
        self._tokens: dict[str, Announcement] = {}
        self._publishers: dict[str, Any] = {}
        self._listeners: list[Any] = []

    def start(self) -> None:
        """Read the current state, and listen from now on."""
        info, liveliness = self.session.info, self.session.liveliness()
        self._listeners = [
            info.declare_transport_events_listener(self._transport, history=True),
            info.declare_link_events_listener(self._link, history=True),
            *(liveliness.declare_subscriber(each, self._token, history=True) for each in expressions(self._registry)),
        ]

    def stop(self) -> None:
        """Stop listening; safe to call twice."""
        listeners, self._listeners = self._listeners, []
        with self._lock:
            publishers, self._publishers = list(self._publishers.values()), {}
        release(*listeners, *publishers)

    def modes(self) -> dict[str, str]:
        """Return the mode of each connected session by id."""
        with self._lock:
            return dict(self._modes)

    def addresses(self) -> dict[str, list[str]]:
        """Return the far ends of the links of each connected session by id."""
        with self._lock:
            return {zid: sorted(ends) for zid, ends in self._addresses.items() if ends}

    def tokens(self) -> list[Announcement]:
        """Return the announcements in this segment and in whatever is joined to it."""
        with self._lock:
            return list(self._tokens.values())

    def watch_matching(self, keys: Collection[str]) -> None:
        """Watch whether these keys have receivers; a publisher that never publishes is declared for each."""
        zenoh = library_of(self.session)
        for key in keys:
            if key not in self._publishers:
                pin(self.session, key)
                publisher = self.session.declare_publisher(key, allowed_destination=zenoh.Locality.REMOTE)
                with self._lock:
                    self._publishers[key] = publisher

    def matching(self) -> set[str]:
        """Return the watched keys that have a receiver outside this session."""
        # Polled, not listened to: zenoh-python starts a thread for each listener, and polling takes 2 us.
        with self._lock:
            publishers = dict(self._publishers)
        return {key for key, publisher in publishers.items() if publisher.matching_status.matching}

    def _transport(self, event: zenoh.TransportEvent) -> None:
        zid = str(event.transport.zid)
        with self._lock:
            if _appeared(event):
                self._modes[zid] = str(event.transport.whatami)
            else:
                self._modes.pop(zid, None)
                self._addresses.pop(zid, None)
        self._changed()

    def _link(self, event: zenoh.LinkEvent) -> None:
        with self._lock:
            zid = str(event.link.zid)
            if _appeared(event):
                self._addresses[zid].add(event.link.dst)
            elif zid in self._addresses:  # else its session has gone before
                self._addresses[zid].discard(event.link.dst)
        self._changed()

    def _token(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        token = parse_token(key, self._registry)
        if token is None:
            return
        with self._lock:
            if _appeared(sample):
                self._tokens[key] = token
            else:
                self._tokens.pop(key, None)
        self._changed()


def _appeared(event: zenoh.TransportEvent | zenoh.LinkEvent | zenoh.Sample) -> bool:
    kind: Any = event.kind
    return int(kind) == 0
