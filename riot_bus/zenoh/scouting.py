"""Multicast scouting for sessions: a query without side effects that, by default, does not leave this host."""

from __future__ import annotations

import json
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.zenoh.session import prepare_runtime

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    import zenoh


@dataclass(frozen=True, slots=True)
class Scouting:
    """Settings of scouting.

    Attributes:
        interfaces: Network interfaces to use; `auto` is the default of Zenoh sessions.
        ttl: Number of hops; 0 keeps the query on this host, 1 lets the local network answer too.
        listen_s: Seconds to wait for answers, which arrive within a few milliseconds.
    """

    interfaces: tuple[str, ...] = ("127.0.0.1", "auto")
    address: str = "224.0.0.224:7446"
    ttl: int = 0
    listen_s: float = 0.1


THIS_HOST = Scouting()
"""Settings for this host alone, loopback first."""


@dataclass(frozen=True, slots=True)
class Answer:
    """A session that answered.

    Attributes:
        mode: Mode of the session: `client`, `peer` or `router`.
        locators: Endpoints on which it listens; a session without any cannot bypass a router.
        interface: Interface on which it was asked.
    """

    zid: str
    mode: str
    locators: tuple[str, ...]
    interface: str


def scout(how: Scouting = THIS_HOST, *, until: Collection[str] = ()) -> Mapping[str, Answer]:
    """Scout once on each interface, without any effect on the sessions that answer.

    Args:
        how: Settings of scouting.
        until: Ids of sessions; when all of them have answered, others are not waited for.
    """
    import zenoh

    prepare_runtime()
    answers: dict[str, Answer] = {}
    arrived = threading.Condition()

    def listener(interface: str) -> Any:  # Zenoh's stubs hide the overload for callbacks
        def take(hello: zenoh.Hello) -> None:
            zid = str(hello.zid)
            with arrived:
                answers.setdefault(zid, Answer(zid, str(hello.whatami), tuple(hello.locators), interface))
                arrived.notify_all()

        return take

    running: list[Any] = []
    for interface in how.interfaces:
        config = zenoh.Config()
        for key, value in (("address", how.address), ("interface", interface), ("ttl", how.ttl)):
            config.insert_json5(f"scouting/multicast/{key}", json.dumps(value))
        running.append(zenoh.scout(listener(interface), what="router|peer|client", config=config))
    deadline = time.monotonic() + min(how.listen_s, 0.9)  # Zenoh asks again after a second: that is never reached
    with arrived:
        while (left := deadline - time.monotonic()) > 0 and not (until and set(until) <= answers.keys()):
            arrived.wait(left)
    for each in running:
        each.stop()
    with arrived:
        return dict(sorted(answers.items()))
