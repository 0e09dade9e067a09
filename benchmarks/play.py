"""How well logs are played, as the player and a subscriber see it: `python benchmarks/play.py [--json FILE]`.

Pacing at 1 kHz beside a plain player (`time.sleep` until each message is due), rates from 0.1 to 50, messages per
second as fast as possible beside plain reading and putting, and whether 100 plays of one log arrive in one order.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import statistics
import struct
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.log.writer import LogWriter
from riot_bus.play.options import PlayOptions
from riot_bus.play.service import PlayService
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import free_endpoint, open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import router_config

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

KEYS = tuple(f"bench/play/{number}" for number in range(5))
RATES = (0.1, 0.5, 1.0, 2.0, 10.0, 50.0)
BEGIN = 1_700_000_000 * 10**9
MS = 10**6
TARGET_MS = 1.0
PLAYS = 100
NUMBER = struct.Struct("<Q")
TIMEOUT_S = 120.0


def write_log(path: Path, count: int, *, period_ns: int, size: int = 64) -> Path:
    """A log of numbered messages over all keys in turn."""
    body = bytes(size - NUMBER.size)
    with LogWriter(path) as writer:
        for number in range(count):
            key = KEYS[number % len(KEYS)]
            writer.write(Message(BEGIN + number * period_ns, key, NUMBER.pack(number) + body, sequence=number))
    return path


def quantiles(errors: list[float]) -> dict[str, float]:
    """p50, p99 and the largest of some milliseconds."""
    ordered = sorted(errors)
    return {
        "p50_ms": round(ordered[len(ordered) // 2], 4),
        "p99_ms": round(ordered[min(len(ordered) - 1, int(len(ordered) * 0.99))], 4),
        "max_ms": round(ordered[-1], 4),
    }


# -- processes of their own -------------------------------------------------------------------------------------------


def run_router(pipe: Connection) -> None:
    """A plain Zenoh router until the pipe ends."""
    endpoint = free_endpoint()
    session = open_session(router_config(listen=[endpoint]), purpose="router")
    pipe.send(endpoint)
    pipe.recv()
    release(session)


def run_subscriber(pipe: Connection, endpoint: str) -> None:
    """Notes number and time of arrival, on Zenoh's own thread; answers `take N` with what came."""
    import zenoh

    config = zenoh.Config()
    for key, value in {"mode": "client", "connect/endpoints": [endpoint], "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    arrived: list[tuple[int, bytes]] = []

    def take(sample: zenoh.Sample) -> None:
        arrived.append((time.monotonic_ns(), sample.payload.to_bytes()[: NUMBER.size]))

    subscribers = [session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False)) for key in KEYS]
    pipe.send(None)
    while (count := pipe.recv()) is not None:
        deadline = time.monotonic() + TIMEOUT_S
        while len(arrived) < count and time.monotonic() < deadline:
            time.sleep(0.001)
        pipe.send([(at, NUMBER.unpack(number)[0]) for at, number in arrived])
        arrived.clear()
    release(*subscribers, session)


def run_player(pipe: Connection, options: PlayOptions) -> None:
    """Play as `riot play` does; answer with what the player says of itself."""
    from riot_bus.control.terminal import Foreground
    from riot_bus.play.running import run_play

    lines: list[str] = []
    run_play(options, Foreground(lines.append, lambda line: print(line, file=sys.stderr), as_json=True))
    pipe.send(json.loads(lines[-1]))


def run_plain_player(pipe: Connection, endpoint: str, path: Path, rate: float) -> None:
    """What one writes first: read with mcap, sleep until a message is due (but not at rate 0), put."""
    import zenoh
    from mcap.reader import make_reader

    config = zenoh.Config()
    for key, value in {"mode": "client", "connect/endpoints": [endpoint], "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    block = zenoh.CongestionControl.BLOCK
    publishers = {key: session.declare_publisher(key, congestion_control=block) for key in KEYS}
    time.sleep(0.5)  # until they have matched
    late: list[float] = []
    with path.open("rb") as file:
        began = time.monotonic_ns()
        for _, channel, message in make_reader(file).iter_messages():
            if rate:
                due = began + int((message.log_time - BEGIN) / rate)
                remaining = due - time.monotonic_ns()
                if remaining > 0:
                    time.sleep(remaining / 1e9)
                late.append((time.monotonic_ns() - due) / MS)
            publishers[channel.topic].put(message.data)
        seconds = (time.monotonic_ns() - began) / 1e9
    pipe.send({"seconds": seconds, **(quantiles(late) if late else {})})
    release(*publishers.values(), session)


@contextmanager
def process(target: Any, *arguments: Any) -> Iterator[Connection]:
    """Another process and the pipe to it."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    child = context.Process(target=target, args=(there, *arguments), daemon=True)
    child.start()
    there.close()
    try:
        yield here
    finally:
        if child.is_alive():
            with suppress(OSError):
                here.send(None)
            child.join(20)
        here.close()


# -- what is measured -------------------------------------------------------------------------------------------------


def options_of(endpoint: str, path: Path, **more: Any) -> PlayOptions:
    return PlayOptions(**{"logs": [path], "endpoint": endpoint, "wait": 10.0, "control": False, **more})


def play(endpoint: str, path: Path, rate: float, *, plain: bool = False) -> dict[str, Any]:
    """Play in a process of its own; return what the player says."""
    target, arguments = (
        (run_plain_player, (endpoint, path, rate)) if plain else (run_player, (options_of(endpoint, path, rate=rate),))
    )
    with process(target, *arguments) as pipe:
        if not pipe.poll(TIMEOUT_S):
            raise TimeoutError("the player did not end")
        found: dict[str, Any] = pipe.recv()
        return found


def by_arrival(arrived: list[tuple[int, int]], period_ns: int, rate: float) -> dict[str, float]:
    """How late messages arrived: against a time line through the earliest one, so that transport's least delay is 0."""
    lags = [at - int(number * period_ns / rate) for at, number in arrived]
    least = min(lags)
    return quantiles([(lag - least) / MS for lag in lags])


def pacing(endpoint: str, subscriber: Connection, folder: Path, count: int, *, plain: bool) -> dict[str, Any]:
    """Play at 1 kHz."""
    path = write_log(folder / "pacing.mcap", count, period_ns=MS)
    told = play(endpoint, path, 1.0, plain=plain)
    subscriber.send(count)
    arrived = subscriber.recv()
    own = told if plain else {f"{name}_ms": round(told["lateness"][name] * 1e3, 4) for name in ("p50", "p99", "max")}
    return {
        "player": "time.sleep" if plain else "riot play",
        "messages": len(arrived),
        "in_order": [number for _, number in arrived] == list(range(count)),
        "by_player": {name: round(value, 4) for name, value in own.items() if name.endswith("_ms")},
        "by_arrival": by_arrival(arrived, MS, 1.0),
    }


def at_rate(endpoint: str, subscriber: Connection, folder: Path, rate: float, seconds: float) -> dict[str, Any]:
    """Play a log of 100 Hz faster or slower; how long it took between the first and the last arrival."""
    period = 10 * MS
    count = max(20, int(seconds * rate * 100))
    told = play(endpoint, write_log(folder / "rate.mcap", count, period_ns=period), rate)
    subscriber.send(count)
    arrived = subscriber.recv()
    took = (arrived[-1][0] - arrived[0][0]) / 1e9
    wanted = (count - 1) * period / rate / 1e9
    return {
        "rate": rate,
        "messages_per_second": round(100 * rate),
        "messages": len(arrived),
        "in_order": [number for _, number in arrived] == list(range(count)),
        "real_rate": round(rate * wanted / took, 5),
        "by_player": {f"{name}_ms": round(told["lateness"][name] * 1e3, 4) for name in ("p50", "p99", "max")},
        "by_arrival": by_arrival(arrived, period, rate),
    }


def throughput(
    endpoint: str, subscriber: Connection, folder: Path, count: int, size: int, *, plain: bool
) -> dict[str, Any]:
    """Play as fast as possible; messages per second between the first and the last arrival."""
    path = write_log(folder / "fast.mcap", count, period_ns=MS, size=size)
    play(endpoint, path, 0.0, plain=plain)
    subscriber.send(count)
    arrived = subscriber.recv()
    return {
        "player": "mcap and put" if plain else "riot play",
        "payload_bytes": size,
        "messages": len(arrived),
        "in_order": [number for _, number in arrived] == list(range(count)),
        "messages_per_second": round((len(arrived) - 1) * 1e9 / (arrived[-1][0] - arrived[0][0])),
    }


def repeated(endpoint: str, subscriber: Connection, folder: Path, plays: int) -> dict[str, Any]:
    """Play one log again and again, at the recorded pace times 50 and as fast as possible in turn."""
    count = 1000
    path = write_log(folder / "order.mcap", count, period_ns=MS)
    digests: dict[str, int] = {}
    for number in range(plays):
        with PlayService(options_of(endpoint, path, rate=0.0 if number % 2 else 50.0)) as service:
            service.wait(TIMEOUT_S)
        subscriber.send(count)
        order = ",".join(str(each) for _, each in subscriber.recv())
        digest = hashlib.sha256(order.encode()).hexdigest()
        digests[digest] = digests.get(digest, 0) + 1
    expected = hashlib.sha256(",".join(map(str, range(count))).encode()).hexdigest()
    return {"plays": plays, "messages_each": count, "identical": digests.get(expected, 0), "orders": len(digests)}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    prepare_runtime()
    result: dict[str, Any] = {"processors": os.cpu_count(), "load_at_begin": round(os.getloadavg()[0], 2)}
    result["keelson"] = "left out: its package on PyPI has no player"
    with tempfile.TemporaryDirectory() as name, process(run_router) as router:
        folder, endpoint = Path(name), router.recv()
        with process(run_subscriber, endpoint) as subscriber:
            subscriber.recv()
            open_client(endpoint).close()  # the router answers
            rounds = [
                pacing(endpoint, subscriber, folder, options.pacing, plain=plain)
                for _ in range(options.repeats)
                for plain in (False, True)
            ]
            result["pacing_1_khz"] = rounds
            result["rates"] = [at_rate(endpoint, subscriber, folder, rate, options.seconds) for rate in RATES]
            result["as_fast_as_possible"] = [
                throughput(endpoint, subscriber, folder, count, size, plain=plain)
                for count, size in ((options.count, 64), (options.count // 10, 10_000))
                for plain in (False, True)
            ]
            result["repeated"] = repeated(endpoint, subscriber, folder, options.plays)
    ours = [each for each in rounds if each["player"] == "riot play"]
    result["pacing_p99_ms"] = {
        "by_player": statistics.median(each["by_player"]["p99_ms"] for each in ours),
        "by_arrival": statistics.median(each["by_arrival"]["p99_ms"] for each in ours),
        "target": TARGET_MS,
    }
    result["load_at_end"] = round(os.getloadavg()[0], 2)
    return result


def _late(row: dict[str, Any]) -> str:
    parts = [f"{row[who][f'{name}_ms']:>9.3f}" for who in ("by_player", "by_arrival") for name in ("p50", "p99", "max")]
    return "".join(parts)


def show(result: dict[str, Any]) -> None:
    print(f"{'late by ms:':24}{'player p50':>9}{'p99':>9}{'max':>9}{'arrived p50':>9}{'p99':>9}{'max':>9}")
    for row in result["pacing_1_khz"]:
        print(f"{'1 kHz, ' + row['player']:24}{_late(row)}  order {'kept' if row['in_order'] else 'BROKEN'}")
    for row in result["rates"]:
        title = f"{row['rate']:g}x, {row['messages_per_second']} msg/s"
        print(f"{title:24}{_late(row)}  real rate {row['real_rate']:.4f}")
    for row in result["as_fast_as_possible"]:
        title = f"{row['player']}, {row['payload_bytes']} bytes"
        order = "kept" if row["in_order"] else "BROKEN"
        print(f"{title:32}{row['messages_per_second']:>10,} msg/s, {row['messages']:,} arrived, order {order}")
    again = result["repeated"]
    print(f"{again['identical']} of {again['plays']} plays arrived in the identical order, the log's")
    print(f"keelson's replay: {result['keelson']}; load {result['load_at_begin']} to {result['load_at_end']}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here too")
    parser.add_argument("--pacing", type=int, default=20_000, help="messages at 1 kHz")
    parser.add_argument("--repeats", type=int, default=3, help="rounds of pacing")
    parser.add_argument("--seconds", type=float, default=4.0, help="for each rate")
    parser.add_argument("--count", type=int, default=100_000, help="messages as fast as possible")
    parser.add_argument("--plays", type=int, default=PLAYS)
    options = parser.parse_args()
    result = measure(options)
    show(result)
    if options.json is not None:
        options.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
