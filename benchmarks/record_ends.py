"""The processes of benchmarks/record.py: a router, a publisher, and the least that can be called a recorder."""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from pathlib import Path

import zenoh


def session(mode: str, **settings: object) -> zenoh.Session:
    config = zenoh.Config()
    for key, value in {"mode": mode, "scouting/delay": 0, "scouting/multicast/enabled": False, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def router(endpoint: str) -> None:
    opened = session("router", **{"listen/endpoints": [endpoint]})
    print("ready", flush=True)
    threading.Event().wait()
    opened.close()  # type: ignore[no-untyped-call]


def publish(endpoint: str, key: str, count: int, rate: float, folder: str) -> None:
    """Publish the payloads of a folder in turn, without loss; if at a rate, then with numbers before them."""
    payloads = [path.read_bytes() for path in sorted(Path(folder).iterdir())]
    opened = session("client", **{"connect/endpoints": [endpoint]})
    publisher = opened.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    while not publisher.matching_status.matching:
        time.sleep(0.001)
    print("matched", flush=True)
    sys.stdin.readline()
    began = time.monotonic()
    for number in range(count):
        payload = payloads[number % len(payloads)]
        if rate:
            payload = number.to_bytes(8, "little") + payload
            if number % 20 == 0:
                time.sleep(max(0.0, began + number / rate - time.monotonic()))
        publisher.put(payload)
    print(json.dumps({"began": began, "ended": time.monotonic()}), flush=True)
    sys.stdin.readline()
    opened.close()  # type: ignore[no-untyped-call]


def record_bare(endpoint: str, key: str, path: str) -> None:
    """A subscriber whose callback writes with the plain `mcap` writer: no queue, no attachments, no QoS, no counts."""
    from mcap.writer import Writer

    with Path(path).open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels: dict[str, int] = {}
        sequence = 0

        def take(sample: zenoh.Sample) -> None:
            nonlocal sequence
            name = str(sample.key_expr)
            channel = channels.get(name)
            if channel is None:
                channel = channels[name] = writer.register_channel(name, "", 0)
            now = time.time_ns()
            sequence += 1
            writer.add_message(channel, now, sample.payload.to_bytes(), now, sequence)

        opened = session("client", **{"connect/endpoints": [endpoint]})
        subscriber = opened.declare_subscriber(key, take)
        signal.sigwait({signal.SIGTERM, signal.SIGINT})
        subscriber.undeclare()  # type: ignore[no-untyped-call]
        opened.close()  # type: ignore[no-untyped-call]
        writer.finish()  # type: ignore[no-untyped-call]


def main() -> None:
    what, *arguments = sys.argv[1:]
    if what == "router":
        router(*arguments)
    elif what == "publish":
        endpoint, key, count, rate, folder = arguments
        publish(endpoint, key, int(count), float(rate), folder)
    else:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
        record_bare(*arguments)


if __name__ == "__main__":
    main()
