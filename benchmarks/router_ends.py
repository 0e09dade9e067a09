"""The processes that `benchmarks/router.py` starts: routers, publishers, subscribers and the latency probe.

Each talks with the measuring process through a pipe, and ends when that pipe ends.
"""

from __future__ import annotations

import statistics
import struct
import tempfile
import threading
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import zenoh

from riot_bus.control.heap import calm_collector, steady_heap
from riot_bus.control.router_process import Upkeep
from riot_bus.inject.interceptor import Injector
from riot_bus.pipeline.runner import Pipeline
from riot_bus.router.bus import Bus
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.injection import Injection
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.segments import EPHEMERAL, Segment
from riot_bus.zenoh.session import listening, open_session, prepare_runtime, release, wait_until
from riot_bus.zenoh.session_config import router_config

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection

    from riot_bus.pipeline.event import Event

PATHS = {
    "plain": "one plain router",
    "chain": "two plain routers in a chain",
    "three": "three plain routers in a chain",
    "free": "riot, un-intercepted",
    "junction": "riot, un-intercepted, after a change",
    "cut": "riot, intercepted",
    "look": "riot, intercepted, one interceptor looks",
    "inject": "riot, one scalar injected",
    "naive": "naive Python callback",
}
ANCHOR = "chain"
FREE = ("free", "junction")  # paths whose messages are not intercepted
TIMEOUT_S = 15.0
WARM_UP_S = 0.5
_LOOK_S = 0.2  # as `riot router`

VALUE, INJECTED = 1.5, 2.5
DEFINITION = "float64 value\nuint8[] data\n"
SMALLEST = 24
_HEADER = struct.Struct("<4sdI")
_NUMBER = struct.Struct("<Q")
_NUMBER_AT = 16  # the first eight bytes of the array
_PROBE, _BEGIN, _END, _LAST = (2**64 - n for n in (1, 2, 3, 4))  # in place of a number
_RING_BYTES = 1 << 25
_SEGMENTS: dict[str, Sequence[str]] = {"a": (), "b": ()}


class Seen(TypedDict):
    """What a subscriber saw."""

    count: int
    disordered: int
    rate: float
    value: float | None


class Delays(TypedDict):
    """What the latency probe measured, in microseconds."""

    p50: float
    p99: float
    lost: int


def payload(size: int, number: int) -> bytes:
    """Return a CDR message of `DEFINITION` with this size and the number at the beginning of its array."""
    header = _HEADER.pack(b"\0\1\0\0", VALUE, size - _NUMBER_AT)
    return header + _NUMBER.pack(number) + bytes(size - SMALLEST)


def key_of(path: str, direction: str) -> str:
    """Return a key that is cut, or one that is not."""
    return f"{'free' if path in FREE else 'cut'}/{direction}"


class Look:
    """An interceptor that does nothing."""

    def message(self, event: Event) -> None:
        """Look."""


# -- routers ----------------------------------------------------------------------------------------------------------


def serve(path: str, pipe: Connection) -> None:
    """Run the router of a path; tell the endpoints of its two ends."""
    zenoh.init_log_from_env_or("warn")  # else a link that is closed under load says nothing
    prepare_runtime()  # the same receive threads for all paths
    with _ROUTERS.get(path, _bus)(path) as ends:
        pipe.send(ends)
        upkeep = (lambda: None) if path in _ROUTERS else Upkeep()
        while not pipe.poll(_LOOK_S):
            upkeep()


@contextmanager
def _plain(_: str) -> Iterator[tuple[str, str]]:
    only = Segment("a")
    yield only.endpoints[0], only.endpoints[0]
    only.close()


@contextmanager
def _chain(path: str) -> Iterator[tuple[str, str]]:
    routers = [Segment("a")]
    for name in ("b", "c") if path == "three" else ("b",):
        routers.append(Segment(name, config={"connect/endpoints": [routers[-1].endpoints[0]]}))
    yield routers[0].endpoints[0], routers[-1].endpoints[0]
    for router in reversed(routers):
        router.close()


@contextmanager
def _naive(_: str) -> Iterator[tuple[str, str]]:
    routers = [open_session(router_config(listen=[EPHEMERAL]), purpose="router") for _ in range(2)]
    for source, target in (routers, reversed(routers)):
        source.declare_subscriber("cut/**", _forwarder(target), allowed_origin=zenoh.Locality.REMOTE)
    ends = [listening(router)[0] for router in routers]
    yield ends[0], ends[1]
    release(*routers)


def _forwarder(target: zenoh.Session) -> Callable[[zenoh.Sample], None]:
    def forward(sample: zenoh.Sample) -> None:
        target.put(
            sample.key_expr,
            sample.payload,
            encoding=sample.encoding,
            congestion_control=sample.congestion_control,
            priority=sample.priority,
            express=sample.express,
            attachment=sample.attachment,
        )

    return forward


@contextmanager
def _bus(path: str) -> Iterator[tuple[str, str]]:
    steady_heap()  # this, and what is done to the collector, as `riot router` does
    with ExitStack() as stack:
        interceptors: list[object] = []
        registry = TypeRegistry()
        if path == "look":
            interceptors = [Look()]
        elif path == "inject":
            interceptors = [Injector([Injection("cut/**", field="value", value=INJECTED)])]
            registry = _registry(Path(stack.enter_context(tempfile.TemporaryDirectory())))
        pipeline = Pipeline(interceptors, registry=registry, provenance=False)
        stack.callback(pipeline.close)
        first = "other/**" if path == "junction" else "cut/**"
        bus = stack.enter_context(Bus(_SEGMENTS, intercept=[first], pipeline=pipeline, registry=registry))
        if path == "junction":
            bus.set_intercept(["cut/**"])
        calm_collector()
        yield bus.endpoint("a"), bus.endpoint("b")


def _registry(folder: Path) -> TypeRegistry:
    file = folder / "bench_msgs" / "msg" / "Sample.msg"
    file.parent.mkdir(parents=True)
    file.write_text(DEFINITION)
    adapters = load_adapters(["ros2"])
    for adapter in adapters:
        adapter.load([file])
    return TypeRegistry(adapters, declared={"cut/**": "bench_msgs/msg/Sample"})


_ROUTERS = {"plain": _plain, "chain": _chain, "three": _chain, "naive": _naive}


# -- clients ----------------------------------------------------------------------------------------------------------


def publish(endpoint: str, key: str, size: int, seconds: float, pipe: Connection) -> None:
    """Publish as fast as the router takes it until told to stop; tell how many messages that were.

    The payloads are made beforehand, so that the publisher is not what is measured. It goes on after the end of the
    measurement: a router with deep queues would else empty them while nobody competes for the processor.
    """
    ring = min(4096, _RING_BYTES // size)
    payloads = [zenoh.ZBytes(payload(size, number)) for number in range(ring)]
    burst = max(1, (1 << 16) // size)
    zenoh.init_log_from_env_or("warn")
    with open_client(endpoint) as client:
        publisher = _publisher(client.session, key)
        put = publisher.put
        pipe.send("matching")
        while not pipe.poll(0.01):  # until the parent knows that the route is there
            put(payload(size, _PROBE))
        pipe.recv()
        sent = 0
        for marker, duration in ((_BEGIN, WARM_UP_S), (_END, seconds), (_LAST, seconds + TIMEOUT_S)):
            end = time.perf_counter() + duration
            while time.perf_counter() < end and not (marker == _LAST and pipe.poll()):
                for _ in range(burst):
                    put(payloads[sent % ring])
                    sent += 1
            put(payload(size, marker))
        pipe.send(sent)
        pipe.recv()  # "stop"
        pipe.poll(2 * TIMEOUT_S)  # leaving before the receiver has all would take queued messages along
        release(publisher)


def subscribe(endpoint: str, key: str, size: int, seconds: float, pipe: Connection) -> None:
    """Count messages and check their order; tell the rate between the marks that the publisher set."""
    ring = min(4096, _RING_BYTES // size)
    route, measured, done = threading.Event(), threading.Event(), threading.Event()
    marks: list[tuple[int, float]] = []
    count = expected = disordered = 0
    value = None
    zenoh.init_log_from_env_or("warn")

    def take(sample: zenoh.Sample) -> None:
        nonlocal count, expected
        body = sample.payload.to_bytes()
        number = int.from_bytes(body[_NUMBER_AT:SMALLEST], "little")
        if number == expected:
            count += 1
            expected = (expected + 1) % ring
        else:
            take_other(number, body)

    def take_other(number: int, body: bytes) -> None:
        nonlocal count, expected, disordered, value
        if number == _PROBE:
            route.set()
        elif number in (_BEGIN, _END):
            marks.append((count, time.perf_counter()))
            if number == _END:
                value = _HEADER.unpack_from(body)[1]
                measured.set()
        elif number == _LAST:
            done.set()
        else:
            count += 1
            disordered += 1
            expected = (number + 1) % ring

    with open_client(endpoint) as client:
        subscriber = client.session.declare_subscriber(key, take)
        if not route.wait(TIMEOUT_S):
            raise TimeoutError(f"no route for {key}")
        pipe.send("route")
        measured.wait(WARM_UP_S + seconds + TIMEOUT_S)
        pipe.send("measured")
        done.wait(TIMEOUT_S)
        rate = 0.0
        if len(marks) == 2:
            (first, begin), (last, end) = marks
            rate = (last - first) / (end - begin)
        pipe.send(Seen(count=count, disordered=disordered, rate=rate, value=value))
        release(subscriber)


def delays(ends: tuple[str, str], key: str, size: int, seconds: float, pipe: Connection) -> None:
    """Measure latency at 1 kHz in one process, so that one clock serves both ends."""
    total = int(seconds * 1000)
    sent = [0] * total
    found: list[float] = []
    route = threading.Event()

    def take(sample: zenoh.Sample) -> None:
        now = time.perf_counter_ns()
        number = int.from_bytes(sample.payload.to_bytes()[_NUMBER_AT:SMALLEST], "little")
        if number < total:
            found.append((now - sent[number]) / 1e3)
        else:
            route.set()

    with open_client(ends[0]) as source, open_client(ends[1]) as sink:
        subscriber = sink.session.declare_subscriber(key, take)
        publisher = _publisher(source.session, key)
        deadline = time.monotonic() + TIMEOUT_S
        while not route.wait(0.02):
            if time.monotonic() > deadline:
                raise TimeoutError(f"no route for {key}")
            publisher.put(payload(size, _PROBE))
        time.sleep(0.1)
        start = time.perf_counter()
        for number in range(total):
            body = payload(size, number)
            time.sleep(max(0.0, start + number / 1000 - time.perf_counter()))
            sent[number] = time.perf_counter_ns()
            publisher.put(body)
        wait_until(lambda: len(found) >= total, 5.0, interval=0.01)
        release(subscriber, publisher)
    centiles = statistics.quantiles(found, n=100)
    pipe.send(Delays(p50=centiles[49], p99=centiles[98], lost=total - len(found)))


def _publisher(session: zenoh.Session, key: str) -> Any:
    publisher: Any = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    if not wait_until(lambda: publisher.matching_status.matching, TIMEOUT_S):
        raise TimeoutError(f"nobody subscribes to {key}")
    return publisher
