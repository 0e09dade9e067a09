"""What tests of advanced pub/sub have in common: components that are sessions of this process, and what they see."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import zenoh
from zenoh import ext

from riot_bus.pipeline.event import Event
from riot_bus.router.bus import Bus
from riot_bus.types.registry import TypeRegistry
from riot_bus.zenoh.session import open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import client_config
from tests.integration.fault_tools import SEGMENTS, pipeline

KEY = "cut/k"
WAIT_S = 60.0

Join = Callable[..., zenoh.Session]
"""Opens the session of a component in a segment, with further configuration; it is closed at the end."""


class Prefix:
    """Changes every message, so that originals are recognised."""

    def message(self, event: Event) -> None:
        event.replace(b"x:" + event.payload)


def changed(texts: Sequence[str]) -> list[str]:
    return [f"x:{text}" for text in texts]


def component(endpoint: str, **settings: Any) -> zenoh.Session:
    """Open a session; in names of settings, `__` stands for `/`."""
    prepare_runtime()
    more = {"timestamping/enabled": True, **{name.replace("__", "/"): value for name, value in settings.items()}}
    return open_session(client_config(endpoint, extra=more), purpose="component")


@contextlib.contextmanager
def running(
    *interceptors: object, intercept: Sequence[str] = ("cut/**",), **options: Any
) -> Iterator[tuple[Bus, Join]]:
    """Open a bus, and let components join."""
    registry = options.pop("registry", None) or TypeRegistry()
    with contextlib.ExitStack() as stack:
        segments = options.pop("segments", SEGMENTS)
        bus = stack.enter_context(
            Bus(segments, intercept=intercept, pipeline=pipeline(*interceptors, registry=registry), **options)
        )

        def join(segment: str, **settings: Any) -> zenoh.Session:
            session = component(bus.endpoint(segment), **settings)
            stack.callback(release, session)
            return session

        yield bus, join


def advertise(
    session: zenoh.Session,
    key: str = KEY,
    *,
    depth: int | None = 3,
    numbered: bool = True,
    heartbeat: float | None = None,
    visible: bool = True,
) -> Any:
    """Declare an advanced publisher; `depth` None: without a cache, `visible`: with a token."""
    misses = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=heartbeat)
    return ext.declare_advanced_publisher(
        session,
        key,
        congestion_control=zenoh.CongestionControl.BLOCK,
        cache=None if depth is None else ext.CacheConfig(depth),
        sample_miss_detection=misses if numbered else None,
        publisher_detection=visible,
    )


class Listener:
    """An advanced subscriber and what it got.

    Args:
        session: Whose.
        key: Key expression.
        history: How many samples of the past it wants; 0 for none.
        late: Whether it asks publishers that appear later, too.
        recovery: Whether it asks for what was lost.
    """

    def __init__(
        self, session: zenoh.Session, key: str = KEY, *, history: int = 100, late: bool = True, recovery: bool = True
    ) -> None:
        self.samples: list[zenoh.Sample] = []
        self.missed: list[int] = []
        self.publishers: list[bool] = []
        """Tokens of publishers that came (True) and went."""
        self._changed = threading.Condition()
        wanted = ext.HistoryConfig(detect_late_publishers=late, max_samples=history)
        self.handle: Any = ext.declare_advanced_subscriber(
            session,
            key,
            self._take,
            history=wanted if history else None,
            recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True) if recovery else None,
            subscriber_detection=True,
        )
        self._misses = self.handle.sample_miss_listener(lambda miss: self._note(self.missed, miss.nb))

    def detect(self) -> None:
        """Look for publishers' tokens."""
        self._detection = self.handle.detect_publishers(
            lambda sample: self._note(self.publishers, int(sample.kind) == 0), history=True
        )

    def texts(self) -> list[str]:
        with self._changed:
            return [sample.payload.to_string() for sample in self.samples]

    def wait(self, count: int) -> list[str]:
        """Wait for so many samples; return the texts of all that came."""
        self.until(lambda: len(self.samples) >= count)
        return self.texts()

    def end(self, text: str) -> list[str]:
        """Wait for this text; return all that came."""
        self.until(lambda: any(sample.payload.to_string() == text for sample in self.samples))
        return self.texts()

    def until(self, condition: Callable[[], bool]) -> bool:
        with self._changed:
            return self._changed.wait_for(condition, WAIT_S)

    def _take(self, sample: zenoh.Sample) -> None:
        self._note(self.samples, sample)

    def _note(self, where: list[Any], what: Any) -> None:
        with self._changed:
            where.append(what)
            self._changed.notify_all()


class PlainListener(Listener):
    """A plain subscriber and what it got."""

    def __init__(self, session: zenoh.Session, key: str = KEY) -> None:
        self.samples, self.missed, self.publishers = [], [], []
        self._changed = threading.Condition()
        self.handle = session.declare_subscriber(key, self._take)


def ask(session: zenoh.Session, selector: str) -> list[str]:
    """Return the texts of all answers, as they come."""
    replies = session.get(
        selector,
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        accept_replies=zenoh.ReplyKeyExpr.ANY,
        timeout=WAIT_S,
    )
    return [reply.ok.payload.to_string() for reply in replies if reply.ok is not None]


def cached(session: zenoh.Session, key: str = KEY) -> list[str]:
    """Return what a late joiner would get now."""
    return ask(session, f"{key}/@adv/**")


def answered(session: zenoh.Session) -> None:
    """Wait until what the listeners of a session asked first is answered, when there is no history yet.

    An advanced subscriber of zenoh-ext 1.10.2 whose first question is answered only when there is a publisher may take
    the end of the history for all that there was.
    """
    assert cached(session) == []  # asked later on the same way, so answered later


def tokens(session: zenoh.Session, key: str = KEY) -> list[str]:
    """Return the ids of the sessions that show a publisher, as a new component sees them beside this one.

    Not as this one does: with zenoh 1.10.2, a session that watches tokens and asks for them, too, may get no answer,
    and then hears of them a second time. (The thread that asks is about to hand over what the session knows already,
    while another takes in the router's answer, leaves out what is known, and ends the question.)
    """
    (link,) = session.info.links()
    asking = component(str(link.dst))
    try:
        replies = asking.liveliness().get(f"{key}/@adv/pub/**", timeout=WAIT_S)
        found = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
    finally:
        release(asking)
    return [text.rpartition("/@adv/pub/")[2].split("/")[0] for text in found]


def lossy(flow: str) -> dict[str, Any]:
    """Return settings of a session that loses long messages on their way in (`ingress`) or out (`egress`)."""
    rule = {"id": "lossy", "messages": ["put"], "flows": [flow], "key_exprs": ["cut/**"], "size_limit": 100}
    return {"low_pass_filter": [rule]}


def long(text: str) -> str:
    """Return a text that is lost there."""
    return text + "." * 200


class LateLink:
    """A port at which nobody answers until it is opened; then it leads to an endpoint. For components that wait."""

    def __init__(self) -> None:
        self._server = socket.socket()
        self._server.bind(("127.0.0.1", 0))
        self._sockets = [self._server]
        self._threads: list[threading.Thread] = []

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of a session that waits for the port to be opened."""
        return {
            "mode": "peer",
            "connect__endpoints": [f"tcp/127.0.0.1:{self._server.getsockname()[1]}"],
            "connect__timeout_ms": -1,
            "connect__exit_on_failure": False,
            "connect__retry": {"period_init_ms": 50, "period_max_ms": 50, "period_increase_factor": 1},
            "listen__endpoints": [],
        }

    def open(self, endpoint: str) -> None:
        self._server.listen()
        self._start(self._accept, int(endpoint.rpartition(":")[2]))

    def _accept(self, port: int) -> None:
        with contextlib.suppress(OSError):
            near, _ = self._server.accept()
            far = socket.create_connection(("127.0.0.1", port))
            self._sockets += near, far
            self._start(self._pump, near, far)
            self._pump(far, near)

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)

    def _start(self, run: Callable[..., None], *arguments: Any) -> None:
        self._threads.append(threading.Thread(target=run, args=arguments, daemon=True))
        self._threads[-1].start()

    def __enter__(self) -> LateLink:
        return self

    def __exit__(self, *error: object) -> None:
        for each in self._sockets:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(WAIT_S)
        for each in self._sockets:
            each.close()
