"""Throughput, latency, start-up and memory of the router beside its peers, in one run; about a quarter of an hour.

python benchmarks/router.py [--json FILE] [--quick] [--only PATH ...]

Every router, publisher and subscriber is a process of its own. In each round, each measurement goes once over all paths
before the next one begins, and ratios are those to the anchor of the same round, so that a machine that becomes slower
or faster hits all paths alike. The anchor is a chain of two plain routers: what a network of two segments costs anyway.
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import os
import signal
import statistics
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
from common import machine
from router_ends import (
    ANCHOR,
    INJECTED,
    PATHS,
    TIMEOUT_S,
    VALUE,
    WARM_UP_S,
    delays,
    key_of,
    publish,
    serve,
    subscribe,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection
    from multiprocessing.context import SpawnProcess

SIZES = (64, 1024, 1 << 16, 1 << 20)
WAYS = {1: "one way", 2: "both ways at once"}
RATIO_TARGETS = {
    "free": {1: 0.9, 2: 0.9},
    "junction": {1: 0.9, 2: 0.9},
    "cut": {1: 0.6, 2: 0.7},
    "inject": {1: 0.4, 2: 0.4},
}
DELAY_TARGETS = {"p50": 20.0, "p99": 150.0}
DELAY_PATHS = ("free", "junction", "cut", "look", "inject")
STARTUP_TARGET_S = 0.3
STARTS = 5
SEGMENTS = ("--segment", "system=tcp/127.0.0.1:0", "--segment", "unit=tcp/127.0.0.1:0")
SATURATED = 0.95
SPAWN = multiprocessing.get_context("spawn")


@dataclass
class Child:
    """A process that we started, and our end of its pipe."""

    process: SpawnProcess
    pipe: Connection

    def receive(self, timeout: float = 2 * TIMEOUT_S) -> Any:
        """Return what it says next."""
        if not self.pipe.poll(timeout):
            raise TimeoutError(f"{self.process.name} says nothing for {timeout:g} s")
        return self.pipe.recv()

    @property
    def usage(self) -> psutil.Process:
        """What the system knows of it."""
        return psutil.Process(self.process.pid)


@dataclass
class Flow:
    """One measurement of throughput; two directions are added up. One that lost messages counts as no throughput."""

    messages_per_s: float
    directions: list[float]
    sent: int
    lost: int
    disordered: int
    wrong_value: bool
    cpu: dict[str, float]
    """Cores per process (of two publishers or subscribers the busier one), of all other programs, and altogether."""


@dataclass
class Results:
    """Everything by path, one entry per round; None where a measurement failed."""

    flows: dict[tuple[int, int, str], list[Flow | None]] = field(default_factory=dict)
    delays: dict[str, list[Any]] = field(default_factory=dict)
    memory: dict[str, list[tuple[float, float, float]]] = field(default_factory=dict)
    startup: dict[str, list[float]] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)


# -- measuring --------------------------------------------------------------------------------------------------------


@contextmanager
def child(target: Callable[..., None], *arguments: Any) -> Iterator[Child]:
    ours, theirs = SPAWN.Pipe()
    process = SPAWN.Process(target=target, args=(*arguments, theirs), name=target.__name__, daemon=True)
    process.start()
    theirs.close()
    try:
        yield Child(process, ours)
    finally:
        ours.close()  # tells it to end
        process.join(TIMEOUT_S)
        if process.is_alive():
            process.kill()
            process.join()


def throughput(router: Child, ends: tuple[str, str], path: str, *, size: int, ways: int, seconds: float) -> Flow:
    directions = [("forth", *ends), ("back", *ends[::-1])][:ways]
    with ExitStack() as stack:
        publishers, subscribers = [], []
        for name, source, sink in directions:
            key = key_of(path, name)
            subscribers.append(stack.enter_context(child(subscribe, sink, key, size, seconds)))
            publishers.append(stack.enter_context(child(publish, source, key, size, seconds)))
        for each in (*publishers, *subscribers):
            each.receive()
        usage = _Usage(router, publishers, subscribers)
        for each in publishers:
            each.pipe.send("go")
        for each in subscribers:
            each.receive(WARM_UP_S + seconds + 2 * TIMEOUT_S)
        cpu = usage.cores()
        for each in publishers:
            each.pipe.send("stop")
        sent = sum(each.receive() for each in publishers)
        seen = [each.receive() for each in subscribers]
    expected = INJECTED if path == "inject" else VALUE
    rates = [one["rate"] for one in seen]
    lost = sent - sum(one["count"] for one in seen)
    return Flow(
        messages_per_s=sum(rates) if all(rates) and not lost else 0.0,
        directions=rates,
        sent=sent,
        lost=lost,
        disordered=sum(one["disordered"] for one in seen),
        wrong_value=any(one["value"] != expected for one in seen),
        cpu=cpu,
    )


class _Usage:
    """How many cores everybody takes from now on."""

    def __init__(self, router: Child, publishers: Sequence[Child], subscribers: Sequence[Child]) -> None:
        self._processes = {
            "publisher": [each.usage for each in publishers],
            "router": [router.usage],
            "subscriber": [each.usage for each in subscribers],
        }
        self._began = time.perf_counter()
        self._before = self._times()

    def cores(self) -> dict[str, float]:
        took, times = time.perf_counter() - self._began, self._times()
        used = {name: [(b - a) / took for a, b in zip(self._before[name], times[name], strict=True)] for name in times}
        machine = used.pop("machine")[0]
        others = max(0.0, machine - sum(map(sum, used.values())))
        return {**{name: max(each) for name, each in used.items()}, "others": others, "machine": machine}

    def _times(self) -> dict[str, list[float]]:
        machine = psutil.cpu_times()
        times = {name: [sum(each.cpu_times()[:2]) for each in some] for name, some in self._processes.items()}
        return {**times, "machine": [sum(machine) - machine.idle - getattr(machine, "iowait", 0.0)]}


def latency(ends: tuple[str, str], path: str, *, seconds: float) -> Any:
    with child(delays, ends, key_of(path, "forth"), SIZES[0], seconds) as probe:
        return probe.receive(seconds + 2 * TIMEOUT_S)


def startup(command: Sequence[str]) -> float:
    """Return the time from the start of a process until it prints a line that begins with `ready:`."""
    # As it is installed: with bytecode.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    began = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        watchdog = threading.Timer(TIMEOUT_S, process.kill)
        watchdog.start()
        assert process.stdout is not None
        line = process.stdout.readline()
        took = time.perf_counter() - began
        process.send_signal(signal.SIGTERM)
        process.wait(TIMEOUT_S)
        watchdog.cancel()
    if not line.startswith("ready:"):
        raise TimeoutError(f"{' '.join(command)} did not become ready")
    return took


def measure(paths: list[str], *, rounds: int, seconds: float) -> Results:
    results = Results()

    def note(what: str, action: Callable[..., Any], *arguments: Any, **more: Any) -> Any:
        if sys.stderr.isatty():
            print(f"\r{what:<100}", end="", file=sys.stderr, flush=True)
        try:
            return action(*arguments, **more)
        except (TimeoutError, EOFError, BrokenPipeError, psutil.Error) as error:
            results.failures.append(f"{what}: {type(error).__name__} {error}")
            return None

    alone = "import zenoh, time; print('ready:', flush=True); time.sleep(60)"
    commands = {
        "riot router": [sys.executable, "-m", "riot_bus", "router", *SEGMENTS],
        "interpreter and import of zenoh alone": [sys.executable, "-c", alone],
    }
    for _ in range(STARTS):
        for name, command in commands.items():
            took = note(f"start-up: {name}", startup, command)
            results.startup.setdefault(name, []).extend([] if took is None else [took])
    for number in range(rounds):
        order = paths[::-1] if number % 2 else paths
        title = f"round {number + 1} of {rounds}"
        with ExitStack() as stack:
            routers = {path: stack.enter_context(child(serve, path)) for path in order}
            ends = {path: router.receive() for path, router in routers.items()}
            before = {path: router.usage.memory_info().rss for path, router in routers.items()}
            for size, ways, path in itertools.product(SIZES, WAYS, order):
                what = f"{title}: {_bytes(size)} {WAYS[ways]}, {PATHS[path]}"
                settings = {"size": size, "ways": ways, "seconds": seconds}
                flow = note(what, throughput, routers[path], ends[path], path, **settings)
                results.flows.setdefault((size, ways, path), []).append(flow)
            for path in order:
                found = note(f"{title}: latency, {PATHS[path]}", latency, ends[path], path, seconds=2 * seconds)
                results.delays.setdefault(path, []).append(found)
            for path, router in routers.items():
                after = router.usage.memory_info().rss / 2**20
                most = Path(f"/proc/{router.process.pid}/status").read_text(encoding="ascii").split("VmHWM:")[1]
                results.memory.setdefault(path, []).append((before[path] / 2**20, int(most.split()[0]) / 1024, after))
    if sys.stderr.isatty():
        print(f"\r{'':<100}\r", end="", file=sys.stderr)
    return results


# -- reporting --------------------------------------------------------------------------------------------------------


def _bytes(size: int) -> str:
    return f"{size} B" if size < 1024 else f"{size >> 10} KiB" if size < 1 << 20 else f"{size >> 20} MiB"


def _middle(values: Sequence[float], digits: int = 2) -> dict[str, float]:
    """Return median and spread."""
    return {
        "median": round(statistics.median(values), digits),
        "min": round(min(values), digits),
        "max": round(max(values), digits),
    }


def _verdict(value: float, target: float, *, at_least: bool) -> dict[str, Any]:
    by = value - target if at_least else target - value
    return {"target": target, "met": by >= 0, "by": round(abs(by), 3)}


def _saturated(cpu: dict[str, float]) -> list[str]:
    names = [name for name in ("publisher", "router", "subscriber") if cpu[name] > SATURATED]
    cores = os.cpu_count() or 1
    return [*names, *([f"all {cores} cores"] if cpu["machine"] > SATURATED * cores else [])]


def _throughput_rows(results: Results) -> Iterator[dict[str, Any]]:
    for (size, ways, path), found in results.flows.items():
        good = [flow for flow in found if flow is not None]
        pairs = zip(found, results.flows[size, ways, ANCHOR], strict=True)
        ratios = [a.messages_per_s / b.messages_per_s for a, b in pairs if a and b and b.messages_per_s]
        if not ratios:
            continue
        ratio = _middle(ratios, 3)
        cpu = {name: round(statistics.median(flow.cpu[name] for flow in good), 2) for name in good[0].cpu}
        target = RATIO_TARGETS.get(path, {}).get(ways)
        yield {
            "payload_bytes": size,
            "ways": ways,
            "path": path,
            "messages_per_s": _middle([flow.messages_per_s for flow in good], 0),
            "ratio": ratio,
            "verdict": None if target is None else _verdict(ratio["median"], target, at_least=True),
            "cpu": cpu,
            "saturated": _saturated(cpu),
            "lost": sum(flow.lost for flow in good),
            "disordered": sum(flow.disordered for flow in good),
            "wrong_values": sum(flow.wrong_value for flow in good),
            "rounds": [asdict(flow) for flow in good],
        }


def _latency_rows(results: Results) -> Iterator[dict[str, Any]]:
    for path, found in results.delays.items():
        pairs = [(a, b) for a, b in zip(found, results.delays[ANCHOR], strict=True) if a and b]
        if not pairs:
            continue
        row = {"path": path, "lost": sum(a["lost"] for a, _ in pairs)}
        for name, target in DELAY_TARGETS.items():
            added = _middle([a[name] - b[name] for a, b in pairs], 1)
            verdict = _verdict(added["median"], target, at_least=False) if path in DELAY_PATHS else None
            values = _middle([a[name] for a, _ in pairs], 1)
            row |= {f"{name}_us": values, f"added_{name}_us": added, f"verdict_{name}": verdict}
        yield row


def summary(results: Results, paths: list[str]) -> dict[str, Any]:
    def place(row: dict[str, Any]) -> tuple[int, int, int]:
        return row.get("payload_bytes", 0), row.get("ways", 0), paths.index(row["path"])

    starts = {name: _middle(took, 3) for name, took in results.startup.items() if took}
    verdict = None
    if "riot router" in starts:
        verdict = _verdict(starts["riot router"]["median"], STARTUP_TARGET_S, at_least=False)
    return {
        "machine": machine(),
        "paths": {path: PATHS[path] for path in paths},
        "anchor": ANCHOR,
        "throughput": sorted(_throughput_rows(results), key=place),
        "latency": sorted(_latency_rows(results), key=place),
        "startup_s": {**starts, "verdict": verdict},
        "memory_mib": {
            path: {name: _middle(values, 1) for name, *values in zip(("before", "peak", "after"), *rss, strict=True)}
            for path, rss in results.memory.items()
        },
        "failures": results.failures,
    }


def _said(verdict: dict[str, Any] | None, sign: str, digits: int = 2) -> str:
    if verdict is None:
        return ""
    return f"{sign} {verdict['target']:g} {'met' if verdict['met'] else 'MISSED'} by {verdict['by']:.{digits}f}"


def show(figures: dict[str, Any]) -> None:
    rows = figures["throughput"]
    for size, ways in dict.fromkeys((row["payload_bytes"], row["ways"]) for row in rows):
        print(f"\nthroughput, {_bytes(size)}, {WAYS[ways]}")
        print(
            f"  {'path':<42}{'msg/s':>9}{'(min - max)':>20}{'ratio':>7}{'(min - max)':>14}  {'target':<24}"
            f"{'pub':>5}{'router':>8}{'sub':>6}{'others':>8}{'all':>6}{'lost':>6}  saturated"
        )
        for row in rows:
            if (row["payload_bytes"], row["ways"]) != (size, ways):
                continue
            rate, ratio, cpu = row["messages_per_s"], row["ratio"], row["cpu"]
            rates = f"({rate['min']:,.0f} - {rate['max']:,.0f})"
            ratios = f"({ratio['min']:.2f} - {ratio['max']:.2f})"
            print(
                f"  {PATHS[row['path']]:<42}{rate['median']:>9,.0f}{rates:>20}{ratio['median']:>7.2f}{ratios:>14}"
                f"  {_said(row['verdict'], '>='):<24}{cpu['publisher']:>5.2f}{cpu['router']:>8.2f}"
                f"{cpu['subscriber']:>6.2f}{cpu['others']:>8.2f}{cpu['machine']:>6.2f}{row['lost']:>6}"
                f"  {', '.join(row['saturated']) or 'nobody'}"
            )
    print(f"\nlatency at 1 kHz, {_bytes(SIZES[0])}, microseconds; added: to {PATHS[ANCHOR]}")
    heads = f"{'added p50':>11}{'target':>24}{'added p99':>11}{'target':>26}{'lost':>7}"
    print(f"  {'path':<42}{'p50':>7}{'p99':>8}{heads}")
    for row in figures["latency"]:
        print(
            f"  {PATHS[row['path']]:<42}{row['p50_us']['median']:>7}{row['p99_us']['median']:>8}"
            f"{row['added_p50_us']['median']:>11}{_said(row['verdict_p50'], '<=', 1):>24}"
            f"{row['added_p99_us']['median']:>11}{_said(row['verdict_p99'], '<=', 1):>26}{row['lost']:>7}"
        )
    print(f"\nstart-up until ready, seconds; target of riot router: {_said(figures['startup_s']['verdict'], '<=')}")
    for name, took in figures["startup_s"].items():
        if name != "verdict":
            print(f"  {name:<42}{took['median']:>7.3f} ({took['min']:.3f} - {took['max']:.3f})")
    print("\nmemory of the router's process (RSS), MiB")
    for path, rss in figures["memory_mib"].items():
        print(f"  {PATHS[path]:<42}" + ",".join(f"{rss[name]['median']:>7.1f} {name}" for name in rss))
    print(
        f"\nThe columns pub to all are cores: per process (of two the busier one), of all other programs, and "
        f"altogether of {figures['machine']['cores']}.\n"
        f"A path on which a client is saturated can do more than its figure; '{PATHS['plain']}' shows the most that\n"
        "these clients can take. Figures with others above 0.1 were disturbed by other programs."
    )


def problems(figures: dict[str, Any]) -> list[str]:
    """Return what must never happen: messages lost, out of order or with another value."""
    found = list(figures["failures"])
    for row in figures["throughput"]:
        where = f"{_bytes(row['payload_bytes'])} {WAYS[row['ways']]}, {PATHS[row['path']]}"
        found += [f"{where}: {row[name]} {name}" for name in ("lost", "disordered", "wrong_values") if row[name]]
    found += [f"latency, {PATHS[row['path']]}: {row['lost']} lost" for row in figures["latency"] if row["lost"]]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to this file, too")
    parser.add_argument("--quick", action="store_true", help="one short round, to see that it works")
    parser.add_argument("--only", nargs="+", choices=PATHS, metavar="PATH", help=f"{', '.join(PATHS)}; and the anchor")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=1.5, help="duration of one measurement, after its warm-up")
    options = parser.parse_args()
    paths = [path for path in PATHS if path == ANCHOR or path in (options.only or PATHS)]
    rounds, seconds = (1, 0.3) if options.quick else (options.rounds, options.seconds)
    figures = summary(measure(paths, rounds=rounds, seconds=seconds), paths)
    figures["rounds"], figures["seconds"] = rounds, seconds
    show(figures)
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=2) + "\n")
    if found := problems(figures):
        sys.exit("\nproblems:\n  " + "\n  ".join(found))


if __name__ == "__main__":
    main()
