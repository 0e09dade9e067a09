"""Who on this host answers multicast scouting: a question that leaves nothing behind and, by default, not the host."""

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

__all__ = ["THIS_HOST", "Answer", "Scouting", "scout"]


@dataclass(frozen=True, slots=True)
class Scouting:
    """How to ask.

    Attributes:
        interfaces: Asked on each. `auto` is what Zenoh sessions listen on unless told otherwise.
        address: The multicast group.
        ttl: Hops; 0 keeps the question on this host, 1 lets the local network answer too.
        listen_s: Seconds to wait for answers, which come within some milliseconds.
    """

    interfaces: tuple[str, ...] = ("127.0.0.1", "auto")
    address: str = "224.0.0.224:7446"
    ttl: int = 0
    listen_s: float = 0.1


THIS_HOST = Scouting()
"""Asks this host alone, on loopback first."""


@dataclass(frozen=True, slots=True)
class Answer:
    """A session that answered.

    Attributes:
        zid: Its id.
        mode: `client`, `peer` or `router`.
        locators: Where it says it listens; a session without is no way around anything.
        interface: Where it was asked.
    """

    zid: str
    mode: str
    locators: tuple[str, ...]
    interface: str


def scout(how: Scouting = THIS_HOST, *, until: Collection[str] = ()) -> Mapping[str, Answer]:
    """Ask once on each interface who is there; whoever answers does nothing else about it.

    Args:
        how: Interfaces, port and time of the question.
        until: Ids; when all of them have answered, the rest is not waited for.

    Returns:
        Answers by id, our own sessions included if they listen to scouting.
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
