"""Latency and throughput of the bus: `python benchmarks/bus.py [--json]`; about half a minute."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import statistics
import time
from typing import TYPE_CHECKING, Any

from riot_bus.bus.client import open_client
from riot_bus.bus.router import Bus
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.pipeline.event import Event

PAYLOAD = json.dumps({"value": 1.5, "filling": "x" * 33}).encode()
SEGMENTS: dict[str, Sequence[str]] = {"system": (), "unit": ()}


class Patch:
    """Sets one field of each message."""

    def message(self, event: Event) -> None:
        """Set it."""
        event.set("value", 2.5)


def latency(source: str, sink: str, key: str, seconds: float, out: Any) -> None:
    """Measure in one process, so that one clock serves both ends."""
    import zenoh

    sent: dict[bytes, int] = {}
    delays: list[float] = []
    with open_client(source) as one, open_client(sink) as two:
        subscriber = two.session.declare_subscriber(
            key, lambda sample: delays.append((time.perf_counter_ns() - sent[sample.attachment.to_bytes()]) / 1e3)
        )
        publisher = one.session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
        while not delays:  # the first ones only show that the route is there
            sent[b"first"] = time.perf_counter_ns()
            publisher.put(PAYLOAD, attachment=b"first")
            time.sleep(0.02)
        time.sleep(0.1)
        delays.clear()
        start = time.perf_counter()
        count = int(seconds * 1000)
        for number in range(count):
            time.sleep(max(0.0, start + number / 1000 - time.perf_counter()))
            mark = number.to_bytes(4, "little")
            sent[mark] = time.perf_counter_ns()
            publisher.put(PAYLOAD, attachment=mark)
        deadline = time.monotonic() + 5
        while len(delays) < count and time.monotonic() < deadline:
            time.sleep(0.01)
        del subscriber
    out.put(delays)


def receive(endpoint: str, key: str, count: int, out: Any) -> None:
    """Count messages; answer with the time between the first and the last."""
    times: list[float] = []
    seen = 0

    def take(sample: object) -> None:
        nonlocal seen
        seen += 1
        if seen in (1, count):
            times.append(time.perf_counter())

    with open_client(endpoint) as client:
        subscriber = client.session.declare_subscriber(key, take)
        out.put("ready")
        deadline = time.monotonic() + 20
        while len(times) < 2 and time.monotonic() < deadline:
            time.sleep(0.02)
        del subscriber
    out.put((seen, times[-1] - times[0] if len(times) == 2 else 0.0))


def send(endpoint: str, key: str, count: int, finished: Any) -> None:
    """Publish as fast as the bus takes it."""
    import zenoh

    with open_client(endpoint) as client:
        publisher = client.session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
        while not publisher.matching_status.matching:
            time.sleep(0.005)
        for _ in range(count):
            publisher.put(PAYLOAD)
        finished.wait(30)  # leaving earlier would take queued messages along


def measure(bus: Bus, source: str, sink: str, *, key: str, count: int, seconds: float) -> dict[str, float]:
    """Measure one path."""
    context = multiprocessing.get_context("spawn")
    out = context.Queue()
    ends = bus.endpoint(source), bus.endpoint(sink)
    probe = context.Process(target=latency, args=(*ends, key, seconds, out))
    probe.start()
    delays = out.get(timeout=30)
    probe.join()
    receiver = context.Process(target=receive, args=(ends[1], key, count, out))
    receiver.start()
    out.get(timeout=30)
    bus.wait_subscribed(sink, [key], timeout=10)
    finished = context.Event()
    sender = context.Process(target=send, args=(ends[0], key, count, finished))
    sender.start()
    seen, took = out.get(timeout=60)
    finished.set()
    sender.join()
    receiver.join()
    centiles = statistics.quantiles(delays, n=100)
    return {
        "p50_us": round(centiles[49], 1),
        "p99_us": round(centiles[98], 1),
        "messages_per_s": round((count - 1) / took) if took else 0,
        "lost": count - seen,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--count", type=int, default=100_000, help="messages for throughput")
    parser.add_argument("--seconds", type=float, default=2.0, help="duration of the latency measurement")
    options = parser.parse_args()
    settings = {"count": options.count, "seconds": options.seconds}
    patched = Pipeline([Patch()], registry=TypeRegistry(declared={"cut/x": "json"}))
    rows: dict[str, dict[str, float]] = {}
    with Bus({"only": ()}) as bus:
        rows["one router"] = measure(bus, "only", "only", key="free/x", **settings)
    with Bus(SEGMENTS) as bus:
        rows["across the junction"] = measure(bus, "system", "unit", key="free/x", **settings)
    with Bus(SEGMENTS, intercept=["cut/**"]) as bus:
        rows["intercepted"] = measure(bus, "system", "unit", key="cut/x", **settings)
    with Bus(SEGMENTS, intercept=["cut/**"], pipeline=patched) as bus:
        rows["one field patched"] = measure(bus, "system", "unit", key="cut/x", **settings)
    if options.json:
        print(json.dumps({"payload_bytes": len(PAYLOAD), **rows}))
        return
    print(f"{'path (' + str(len(PAYLOAD)) + ' bytes)':24}{'p50':>10}{'p99':>10}{'one way':>16}{'lost':>8}")
    for name, row in rows.items():
        speed = f"{row['messages_per_s']:,.0f} msg/s"
        print(f"{name:24}{row['p50_us']:>7} us{row['p99_us']:>7} us{speed:>16}{row['lost']:>8}")


if __name__ == "__main__":
    main()
