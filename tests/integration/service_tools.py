"""Components that call and serve, for tests of intercepted services."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import zenoh

from riot_bus.pipeline.event import Event
from riot_bus.pipeline.runner import Pipeline
from riot_bus.router.bus import Bus
from riot_bus.router.counts import TopicCounts
from riot_bus.types.registry import TypeRegistry
from riot_bus.zenoh.client import Client, open_client
from riot_bus.zenoh.session import wait_until

SEGMENTS: dict[str, list[str]] = {"system": [], "unit": []}
ADD = "calc/add"
Found = tuple[str, str]
"""What a reply is (`put`, `delete`, `error`), and its text."""


class Server:
    """A service; it replies `<request>!` on its own key, unless it is told what else to do.

    Attributes:
        asked: Payloads and parameters of requests.
        kept: Requests that it has not answered.
    """

    def __init__(
        self,
        client: Client,
        key: str = ADD,
        reply: Callable[[Any], None] | None = None,
        *,
        complete: bool = True,
        silent: bool = False,
    ) -> None:
        self.asked: list[tuple[str, str]] = []
        self.kept: list[Any] = []
        self._reply, self._silent = reply, silent
        self.queryable = client.session.declare_queryable(key, self._take, complete=complete)

    def _take(self, query: Any) -> None:
        payload = "" if query.payload is None else query.payload.to_string()
        self.asked.append((payload, str(query.parameters)))
        if self._silent:
            self.kept.append(query)
            return
        with query:
            if self._reply is not None:
                self._reply(query)
            else:
                query.reply(query.key_expr, f"{payload}!", attachment=query.attachment)

    def leave(self) -> None:
        self.queryable.undeclare()  # type: ignore[no-untyped-call]


def show(reply: zenoh.Reply) -> Found:
    if reply.ok is None:
        error: Any = reply.err
        return "error", error.payload.to_string()
    return ("delete" if reply.ok.kind == zenoh.SampleKind.DELETE else "put"), reply.ok.payload.to_string()


def call(
    client: Client, payload: str | None = "x", key: str = ADD, *, timeout: float = 60.0, **more: Any
) -> list[Found]:
    """Ask, and return all replies once the call has ended."""
    more.setdefault("consolidation", zenoh.ConsolidationMode.NONE)
    return [show(reply) for reply in client.session.get(key, payload=payload, timeout=timeout, **more)]


def eventually(client: Client, payload: str | None = "x", key: str = ADD, **more: Any) -> list[Found]:
    """Ask until there is a service, which may have been declared just before."""
    found: list[Found] = []

    def answered() -> bool:
        found.extend(call(client, payload, key, **more))
        return bool(found)

    wait_until(answered, 60)
    return found


def present(client: Client, key: str = ADD, *, there: bool = True, complete: bool = True) -> None:
    """Wait until a component sees that there is a service, or that there is none."""
    target = zenoh.QueryTarget.ALL_COMPLETE if complete else zenoh.QueryTarget.BEST_MATCHING
    querier: Any = client.session.declare_querier(key, target=target)
    assert wait_until(lambda: querier.matching_status.matching is there, 60)
    querier.undeclare()


def balance(bus: Bus) -> dict[str, TopicCounts]:
    """Return all counts once nothing is under way, and check that each balances."""
    assert bus.drain(60)
    counts = bus.counts()
    for topic, each in counts.items():
        assert each.received + each.added == each.forwarded + each.dropped + each.lost + each.held, (topic, each)
    return counts


class Script:
    """Does to each message what its text says."""

    def __init__(self) -> None:
        self.seen: list[tuple[str, str, str, tuple[str, ...]]] = []

    def message(self, event: Event) -> None:
        text = event.payload.decode().removesuffix("!")
        part = event.topic.rpartition("/")[2]
        self.seen.append((event.topic, event.payload.decode(), event.segment, event.targets))
        match f"{part} {text}":
            case "@request change me" | "@reply change reply":
                event.replace(b"changed")
            case "@request drop me" | "@reply drop reply":
                event.drop()
            case "@request late" | "@reply late reply":
                event.delay(0.2)
            case "@request twice" | "@reply twice reply":
                event.duplicate()
            case "@reply fail":
                event.message = event.message.with_(key=f"{ADD}/@error", payload=b"broken")
            case "@request forge":
                event.drop()
                event.add(event.message.with_(key=f"{ADD}/@reply", payload=b"forged"))
            case "@request elsewhere":
                event.message = event.message.with_(key="calc/sub/@request")
            case "@request tell":
                event.add(event.message.with_(key="told", payload=b"told"))
            case "@request raise":
                raise RuntimeError("on purpose")


@contextlib.contextmanager
def two(bus: Bus) -> Iterator[tuple[Client, Client]]:
    """A component in each segment."""
    with open_client(bus.endpoint("system")) as system, open_client(bus.endpoint("unit")) as unit:
        yield system, unit


def pipeline(*interceptors: object) -> Pipeline:
    return Pipeline(interceptors, registry=TypeRegistry())


class Parallel:
    """Calls from many callers at once; collects all replies."""

    def __init__(self, client: Client, key: str = ADD) -> None:
        self._client, self._key = client, key
        self.found: dict[int, list[Found]] = {}
        self.ended = 0
        self._lock = threading.Lock()

    def start(self, number: int, timeout: float = 60.0) -> None:
        replies: list[Found] = []

        def end() -> None:
            with self._lock:
                self.found[number] = replies
                self.ended += 1

        self._client.session.get(
            self._key,
            zenoh.handlers.Callback(lambda reply: replies.append(show(reply)), drop=end),  # type: ignore[arg-type]
            payload=str(number),
            timeout=timeout,
        )

    def wait(self, count: int, timeout: float = 60.0) -> bool:
        return wait_until(lambda: self.ended >= count, timeout, interval=0.01)


def elapsed(action: Callable[[], Any]) -> tuple[float, Any]:
    began = time.monotonic()
    found = action()
    return time.monotonic() - began, found
