"""Surveys a network as a client: announcements and their senders, without any query that could harm a router."""

from __future__ import annotations

import os
import socket
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from riot_bus.graph.processes import connections, endpoint_of
from riot_bus.graph.sources import admin_views
from riot_bus.graph.tokens import expressions, parse_token
from riot_bus.types.capabilities import MOST_TOKENS
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.types.capabilities import Announcement
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.zenoh import api as zenoh


Link = tuple[tuple[str, int], tuple[str, int]]


@dataclass(frozen=True, slots=True)
class Started:
    """How a process of this host was started."""

    pid: int
    command: tuple[str, ...]
    cwd: str


@dataclass(frozen=True, slots=True)
class Survey:
    """What is announced at the end of a look at the network.

    Attributes:
        offered: QoS that the publishers of a key offer, in the form of a log's channel (`offered_qos_profiles`).
        started: The processes behind sessions, by the sessions' ids; those of other hosts and users are left out.
        skipped: Number of tokens left out because there were too many.
        modes: `client`, `peer` or `router` of each session that routers say they are linked to, by its id.
    """

    announcements: tuple[Announcement, ...]
    offered: Mapping[str, Mapping[str, str]]
    started: Mapping[str, Started] = field(default_factory=dict)
    skipped: int = 0
    modes: Mapping[str, str] = field(default_factory=dict)


def survey(endpoint: str, registry: TypeRegistry, *, seconds: float, config: Mapping[str, Any] | None = None) -> Survey:
    """Look at the network for some seconds.

    Raises:
        EnvironmentFaultError: No router answers at the endpoint.
    """
    lock = threading.Lock()
    tokens: set[str] = set()
    skipped: set[str] = set()

    def note(sample: zenoh.Sample) -> None:
        from riot_bus.zenoh import api as zenoh

        key = str(sample.key_expr)
        with lock:
            if sample.kind == zenoh.SampleKind.DELETE:
                tokens.discard(key)
                skipped.discard(key)
            elif len(tokens) < MOST_TOKENS:
                tokens.add(key)
            elif len(skipped) < MOST_TOKENS:
                skipped.add(key)

    with open_client(endpoint, config=config) as client:
        liveliness = client.session.liveliness()
        listeners = [liveliness.declare_subscriber(each, note, history=True) for each in expressions(registry)]
        threading.Event().wait(seconds)
        with lock:
            seen = sorted(tokens)
        views = admin_views(client.session).values()
        release(*listeners)
    modes = {zid: mode for view in views for zid, mode in view.sessions.items() if zid != client.zid}
    links = {
        (near, far): zid
        for view in views
        for ends, zid in view.links.items()
        if (near := endpoint_of(ends[0])) is not None and (far := endpoint_of(ends[1])) is not None
    }
    found = {each for token in seen if (each := parse_token(token, registry)) is not None}
    offered = {}
    for key in {each.key for each in found if each.role == "publishes"}:
        stamping = registry.metadata_adapter(key)
        if stamping is not None:
            offered[key] = stamping.details(key, seen)
    ordered = sorted(found, key=lambda each: (each.node, each.zid, each.role or "", each.topic, each.source))
    return Survey(tuple(ordered), offered, _processes(links), len(skipped), modes)


def started_at(endpoint: str) -> list[Started]:
    """Return the other processes of this host that have a TCP connection to an endpoint, sorted by process id."""
    place = endpoint_of(endpoint)
    if place is None:
        return []
    hosts = {place[0]}
    with suppress(OSError):
        hosts |= {str(each[4][0]) for each in socket.getaddrinfo(*place, type=socket.SOCK_STREAM)}
    pids = {each.pid for each in connections() if each.far[1] == place[1] and each.far[0] in hosts}
    found = (_started(pid) for pid in sorted(pids - {0, os.getpid()}))
    return [each for each in found if each is not None]


def _processes(links: Mapping[Link, str]) -> dict[str, Started]:
    found = {}
    for each in connections() if links else ():
        zid = links.get((each.near, each.far))
        started = _started(each.pid) if zid is not None and each.pid else None
        if zid is not None and started is not None:
            found[zid] = started
    return found


def _started(pid: int) -> Started | None:
    """Return how a process of this user was started; None for others, whose commands this one does not repeat."""
    import psutil

    with suppress(psutil.Error, OSError):
        process = psutil.Process(pid)
        command, own = tuple(process.cmdline()), process.uids().effective == os.geteuid()
        return Started(pid, command, process.cwd()) if command and own else None
    return None
