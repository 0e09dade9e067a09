"""Short logs of a small system: /goal and /odom are external, /map follows /goal, /unit follows both /map and /odom."""

from __future__ import annotations

import json

from riot_bus.graph.history import record
from riot_bus.graph.model import ConnectedComponent, Edge, Graph, Topic
from riot_bus.log.layout import GRAPH
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message
from tests.unit.backchain.recordings import late, red

BEGIN = 1_700_000_000 * 10**9
WAYS = {"mapper": (["goal"], ["map"]), "planner": (["map", "odom"], ["unit"])}

SYSTEM = """
[system]
name = "small"

[components.mapper]
command = ["mapper"]
inputs = ["goal"]
outputs = ["map"]

[components.planner]
command = ["planner"]
inputs = ["map", "odom", "lost"]
outputs = ["unit"]

[components.base]
command = ["base"]
external = true
inputs = ["unit"]
outputs = ["odom"]

[external]
topics = ["goal", "odom", "battery"]

[unit.planner]
"""


def known_graph():
    """Return the graph as a recorder has it: nodes announce themselves."""
    edges = [
        Edge(topic, role, "main", f"{name}id", f"/{name}", ("ros2 token",))
        for name, (reads, writes) in WAYS.items()
        for role, topics in (("subscribes", reads), ("publishes", writes))
        for topic in topics
    ]
    nodes = [ConnectedComponent("main", f"{name}id", "client", nodes=(f"/{name}",)) for name in WAYS]
    return Graph.of(nodes, [Topic(name, name) for name in ("goal", "map", "odom", "unit")], edges, [])


def write_log(path, rng, *, count=180, graph=None):
    """Write a log of JSON messages at 10 Hz."""
    goal, odom = red(rng, count, 0.9), red(rng, count, 0.5)
    middle = late(goal, 1) + 0.4 * red(rng, count, 0.5)
    unit = late(middle, 1) + 0.5 * late(odom, 2) + 0.3 * red(rng, count, 0.2)
    series = {"goal": goal, "odom": odom, "battery": red(rng, count, 0.3), "map": middle, "unit": unit}
    with LogWriter(path) as writer:
        if graph is not None:
            writer.note(GRAPH, record(None, graph, time=BEGIN))
        for at in range(count):
            for place, (topic, values) in enumerate(series.items()):
                body = {
                    "v": values[at],
                    "mode": 2,
                    "name": "x",
                    "seq": at,
                    "on": bool(at % 3),
                    "list": [at, 1, 2, 3, 4, 5],
                }
                data = json.dumps(body).encode()
                writer.write(Message(BEGIN + at * 10**8 + place * 10**6, topic, data, encoding="application/json"))
    return path
