"""What `riot backchain` finds in logs alone, on systems whose truth is known.

Usage: python benchmarks/offline.py [--seeds N] [--logs] [--json FILE]

The system has 12 external and 28 internal topics, among them a chain of three components to the field that is asked
for, a loop through an external component, and decoys that follow the same external fields. `--logs` writes ten logs of
it with 1,000,000 messages and runs the command on them in a process of its own, with the graph recorded and without.
"""

from __future__ import annotations

import argparse
import json
import resource
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.backchain.graph import ComponentTopics, TopicGraph
from riot_bus.graph.history import record
from riot_bus.graph.model import ConnectedComponent, Edge, Graph, Topic
from riot_bus.log.layout import GRAPH
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.message import Message
from riot_bus_fleet.evidence.alignment import Piece, held_variants, response_of
from riot_bus_fleet.evidence.backtrack import backtrack
from riot_bus_fleet.evidence.dependence import dependences

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

TYPE, BEGIN, STEP = "geometry_msgs/msg/Twist", 1_700_000_000 * 10**9, 0.01
FIELDS = ("linear.x", "linear.y", "linear.z", "angular.x", "angular.y", "angular.z")
EXTERNALS = [f"/ext{at:02d}" for at in range(12)]
DECOYS = [f"/decoy{at:02d}" for at in range(24)]
TARGET = "/unit:linear.x"
TRUE = {
    "/ext00:linear.x": 0.2,
    "/ext01:linear.x": 0.3,
    "/ext02:linear.x": 0.2,
    "/ext03:linear.x": 0.3,
    "/ext04:linear.x": 0.15,
}
"""External fields that reach the target, and the delay of the way, in seconds."""

RATES = {
    "/ext00": 50,
    "/ext01": 10,
    "/ext02": 20,
    "/ext03": 5,
    "/ext04": 50,
    "/a": 50,
    "/b": 20,
    "/unit": 20,
    "/cmd": 20,
}
OTHERS = (100, 50, 20, 20, 20, 10, 10, 10, 10, 5, 5, 5)
COMPONENTS = {
    "filter": (("/ext00", "/ext01"), ("/a",)),
    "mapper": (("/a", "/ext02", "/ext04"), ("/b",)),
    "planner": (("/b", "/ext03"), ("/unit",)),
    "controller": (("/unit",), ("/cmd",)),
    "simulator": (("/cmd",), ("/ext04",)),
    **{f"node{at:02d}": ((EXTERNALS[at % 12],), (name,)) for at, name in enumerate(DECOYS)},
}


def red(rng: np.random.Generator, shape: tuple[int, int], seconds: float) -> Floats:
    """Return noise of variance 1 with a time constant (logs x steps)."""
    from scipy.signal import lfilter

    keep = np.exp(-STEP / seconds)
    found: Floats = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=shape), axis=1)
    return found


def late(series: Floats, seconds: float) -> Floats:
    """Return a series some time later."""
    steps = round(seconds / STEP)
    return np.hstack([np.repeat(series[:, :1], steps, axis=1), series[:, : series.shape[1] - steps]])


def system(seed: int, *, logs: int, seconds: float) -> list[dict[str, tuple[Floats, Floats]]]:
    """Return for each log the times of each topic's messages and their six fields."""
    rng = np.random.default_rng(seed)
    shape = (logs, round(seconds / STEP))
    others = [name for name in [*EXTERNALS, *DECOYS] if name not in RATES]
    rates = dict(zip(others, OTHERS * 3, strict=False)) | RATES
    every = {name: round(1 / STEP / rate) for name, rate in rates.items()}
    start = {name: int(rng.integers(step)) for name, step in every.items()}

    def held(name: str, series: Floats) -> Floats:
        """Return what the latest message of a topic says: components know no more."""
        at = np.arange(shape[1])
        return series[:, np.maximum(at - (at - start[name]) % every[name], 0)]

    scale = rng.uniform(0.05, 1.0, len(EXTERNALS))
    lead = {name: held(name, red(rng, shape, scale[at])) for at, name in enumerate(EXTERNALS)}
    noise = {name: red(rng, shape, 0.1) for name in ("/a", "/b", "/unit", "/cmd", *DECOYS)}
    lead["/a"] = held("/a", 0.8 * late(lead["/ext00"], 0.1) + 0.6 * late(lead["/ext01"], 0.2) + 0.5 * noise["/a"])
    forced = 1.2 * np.abs(late(lead["/ext02"], 0.15)) + 0.4 * noise["/b"] + 0.7 * late(lead["/a"], 0.05)
    lone = 0.5 * late(lead["/ext03"], 0.3) + 0.4 * noise["/unit"]
    robot, b, unit, cmd, odom = (np.zeros(shape) for _ in range(5))
    kick = rng.normal(size=shape)
    for at in range(1, shape[1]):
        robot[:, at] = 0.9 * robot[:, at - 1] + 0.1 * cmd[:, max(0, at - 20)] + 0.3 * kick[:, at]
        now = {
            "/ext04": (odom, robot[:, at]),
            "/b": (b, forced[:, at] + 0.6 * odom[:, max(0, at - 10)]),
            "/unit": (unit, 0.8 * b[:, max(0, at - 5)] + lone[:, at]),
            "/cmd": (cmd, 0.3 * unit[:, max(0, at - 10)] + 0.3 * noise["/cmd"][:, at]),
        }
        for name, (series, new) in now.items():
            series[:, at] = new if (at - start[name]) % every[name] == 0 else series[:, at - 1]
    lead |= {"/b": b, "/unit": unit, "/cmd": cmd, "/ext04": odom}
    for at, name in enumerate(DECOYS):
        lead[name] = 0.9 * late(lead[EXTERNALS[at % 12]], 0.02 * (at % 5)) + 0.4 * noise[name]
    found: list[dict[str, tuple[Floats, Floats]]] = [{} for _ in range(logs)]
    for name, series in lead.items():
        at = np.arange(start[name], shape[1], every[name])
        further = [red(rng, shape, 0.3) for _ in range(2)]
        for number in range(logs):
            columns = [one[number, at] for one in (series, *further)] + [np.zeros(len(at))] * 3
            found[number][name] = at * STEP + rng.uniform(0, 0.2 * STEP, len(at)), np.stack(columns, axis=1)
    return found


def pieces_of(logs: list[dict[str, tuple[Floats, Floats]]]) -> list[Piece]:
    """Return logs as `backtrack` takes them."""
    return [
        Piece(
            {name: times for name, (times, _) in log.items()},
            {f"{name}:{path}": values[:, at] for name, (_, values) in log.items() for at, path in enumerate(FIELDS)},
            number,
        )
        for number, log in enumerate(logs)
    ]


def topic_graph() -> TopicGraph:
    """Return who reads and writes what."""
    return TopicGraph({n: ComponentTopics(frozenset(i), frozenset(o)) for n, (i, o) in COMPONENTS.items()})


def score(seeds: int, *, logs: int, seconds: float, known: bool) -> dict[str, Any]:
    """Return recall, false discoveries and errors of lags of the external fields, and of the edges, over seeds."""
    recall, false, first, lags, edges, wrong = [], [], [], [], [], []
    true_edges = {
        (i, o[0]) for n, (i_, o) in COMPONENTS.items() for i in i_ if n in ("filter", "mapper", "planner", "controller")
    }
    begin = time.process_time()
    for seed in range(seeds):
        pieces = pieces_of(system(seed, logs=logs, seconds=seconds))
        found = backtrack(
            pieces,
            topic_graph() if known else TopicGraph(),
            [TARGET],
            externals=dict.fromkeys(EXTERNALS, "given"),
            seed=seed,
        )
        named = [one for one in found.ranking if one.found]
        names = [one.source for one in named]
        recall.append(len(set(names) & set(TRUE)) / len(TRUE))
        false.append(len(set(names) - set(TRUE)) / max(1, len(names)))
        first.append({one.source for one in found.ranking[: len(TRUE)]} == set(TRUE))
        lags += [
            one.dependence.lag_s - TRUE[one.source]
            for one in named
            if one.source in TRUE and one.dependence and one.dependence.lag_s is not None
        ]
        shown = {(edge.source, edge.target) for edge in found.edges if any(one.found for one in edge.evidence)}
        on_way = {pair for pair in true_edges if pair[1] in {"/a", "/b", "/unit"}}
        edges.append(len(shown & on_way) / len(on_way))
        wrong.append(len(shown - true_edges) / max(1, len(shown)))
    return {
        "logs": logs,
        "seconds": seconds,
        "graph": "known" if known else "inferred",
        "recall": float(np.mean(recall)),
        "fdr": float(np.mean(false)),
        "true externals first": float(np.mean(first)),
        "lag error ms": float(np.median(np.abs(lags)) * 1000) if lags else None,
        "edge recall": float(np.mean(edges)),
        "edge fdr": float(np.mean(wrong)),
        "cpu s": (time.process_time() - begin) / seeds,
    }


def null(seeds: int, *, logs: int, seconds: float) -> dict[str, Any]:
    """Return how often anything is named where the target follows nothing."""
    named = []
    for seed in range(seeds):
        pieces = pieces_of(system(seed, logs=logs, seconds=seconds))
        response = response_of(pieces, "/unit:linear.y")
        assert not isinstance(response, str)
        variants = {
            f"{n}:linear.{a}": held_variants(pieces, f"{n}:linear.{a}", response) for n in EXTERNALS for a in "xyz"
        }
        found = dependences(response, {n: one for n, one in variants.items() if not isinstance(one, str)}, seed=seed)
        named.append(any(one.found for one in found))
    return {"logs": logs, "seconds": seconds, "any named of 36": float(np.mean(named))}


def write_logs(folder: Path, *, logs: int, seconds: float, graph: bool, seed: int = 0) -> list[Path]:
    """Write logs of the system, and return them."""
    registry = TypeRegistry(load_adapters(), declared=dict.fromkeys([*EXTERNALS, *DECOYS, *RATES], TYPE))
    paths = []
    for number, log in enumerate(system(seed, logs=logs, seconds=seconds)):
        paths.append(folder / f"{number}.mcap")
        names = list(log)
        times = np.concatenate([log[name][0] for name in names])
        owner = np.repeat(np.arange(len(names)), [len(log[name][0]) for name in names])
        values = np.concatenate([log[name][1] for name in names])
        with LogWriter(paths[-1], registry=registry, profile="ros2") as writer:
            if graph:
                writer.note(GRAPH, record(None, recorded(), time=BEGIN))
            for place, at in enumerate(np.argsort(times, kind="stable").tolist()):
                payload = b"\0\1\0\0" + struct.pack("<6d", *values[at])
                writer.write(Message(BEGIN + round(times[at] * 1e9), names[owner[at]], payload, sequence=place))
    return paths


def recorded() -> Graph:
    """Return the graph as a recorder has it: nodes that announce themselves, all but those outside."""
    edges = [
        Edge(topic, role, "main", f"{name}-id", f"/{name}", ("ros2 token",))
        for name, (inputs, outputs) in COMPONENTS.items()
        for role, topics in (("subscribes", inputs), ("publishes", outputs))
        for topic in topics
    ]
    components = [ConnectedComponent("main", f"{name}-id", "client", nodes=(f"/{name}",)) for name in COMPONENTS]
    return Graph.of(components, [Topic(name, name, TYPE) for name in [*EXTERNALS, *DECOYS, *RATES]], edges, [])


def run_command(paths: list[Path]) -> dict[str, Any]:
    """Run the command on logs, and return what it found and what it took."""
    line = [sys.executable, "-m", "riot_bus", "backchain", *map(str, paths), "--to", TARGET, "--format", "json"]
    # the recorded simulator is a node like others, so nothing else says that what it publishes comes from outside
    line += [part for name in EXTERNALS for part in ("--external", name)]
    begin = time.perf_counter()
    done = subprocess.run(line, capture_output=True, text=True, check=True)
    seconds = time.perf_counter() - begin
    found = json.loads(done.stdout)
    named = [one["source"] for one in found["ranking"] if one["verdict"] == "follows"]
    return {
        "graph": found["told"] or "inferred",
        "messages": found["messages"],
        "looked at": found["looked_at"],
        "seconds": seconds,
        "cpu s": sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]),
        "MiB": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024,
        "named": named,
        "true first": {one["source"] for one in found["ranking"][: len(TRUE)]} == set(TRUE),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--logs", action="store_true", help="also the command on ten logs with 1,000,000 messages")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    rows = [
        score(args.seeds, logs=n, seconds=s, known=known)
        for n, s in ((10, 100.0), (3, 60.0), (1, 120.0))
        for known in (True, False)
    ]
    rows += [null(args.seeds, logs=n, seconds=s) for n, s in ((10, 60.0), (1, 60.0))]
    if args.logs:
        for graph in (True, False):
            with tempfile.TemporaryDirectory() as folder:
                rows.append(run_command(write_logs(Path(folder), logs=10, seconds=100.0, graph=graph)))
    for row in rows:
        print(
            "  ".join(
                f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in row.items()
            )
        )
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
