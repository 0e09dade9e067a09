from __future__ import annotations

import numpy as np
import pytest

from riot_bus.backchain.graph import ComponentTopics, TopicGraph
from riot_bus.graph.model import ConnectedComponent, Edge, Graph, Topic
from riot_bus.log.layout import GRAPH
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message
from riot_bus_fleet.evidence.recorded_graph import RecordedComponents, joined
from tests.unit.chain.offline import known_graph, write_log

KEYS = {"goal": "goal", "map": "map", "odom": "odom", "unit": "unit", "arm/left": "arm/left", "arm/right": "arm/right"}


def take(*paths):
    found = RecordedComponents()
    for path in paths:
        with LogReader(path) as reader:
            found.add(reader)
    return found


def log_with(path, graph, *topics):
    from riot_bus.graph.history import record

    with LogWriter(path) as writer:
        writer.note(GRAPH, record(None, graph, time=1))
        for topic in topics:
            writer.write(Message(1, topic, b"1", encoding="application/json"))
    return path


def test_recorded_graphs_of_several_logs_are_one(tmp_path):
    rng = np.random.default_rng(0)
    logs = [write_log(tmp_path / f"{at}.mcap", rng, count=3, graph=known_graph()) for at in range(2)]
    found = take(*logs, write_log(tmp_path / "without.mcap", rng, count=3))
    assert found.logs == 2
    assert found.graph().components == {
        "/mapper": ComponentTopics(frozenset({"goal"}), frozenset({"map"}), "recorded graph"),
        "/planner": ComponentTopics(frozenset({"map", "odom"}), frozenset({"unit"}), "recorded graph"),
    }


def test_who_does_not_announce_itself_may_read_more(tmp_path):
    edges = [
        Edge("a", "publishes", "main", "z1", evidence=("timestamp", "traffic")),
        Edge("b", "publishes", "main", evidence=("traffic",)),
    ]
    graph = Graph.of([ConnectedComponent("main", "z1", name="sensor")], [Topic("a", "a"), Topic("b", "b")], edges, [])
    found = take(log_with(tmp_path / "a.mcap", graph, "a", "b")).graph()
    assert found.components == {"sensor": ComponentTopics(frozenset(), frozenset({"a"}), "recorded graph", open=True)}


def test_what_a_link_takes_goes_to_the_systems_behind_it(tmp_path):
    edges = [
        Edge("mav/HEARTBEAT", "publishes", "main", "main/serial", "1/1", ("bridge",)),
        Edge("mav/COMMAND", "subscribes", "main", "main/serial", "", ("bridge",)),
        Edge("mav/COMMAND", "publishes", "main", "main/gcs", "255/190", ("bridge",)),
        Edge("mav/**", "subscribes", "main", "main/gcs", "", ("bridge",)),
    ]
    graph = Graph.of([], [Topic(name, name) for name in ("mav/HEARTBEAT", "mav/COMMAND", "mav/**")], edges, [])
    found = take(log_with(tmp_path / "a.mcap", graph)).graph()
    assert found.components["1/1"].inputs == {"mav/COMMAND"}
    assert found.components["255/190"].outputs == {"mav/COMMAND"}


def test_parts_of_calls_go_both_ways(tmp_path):
    edges = [
        Edge("add", "calls", "main", "z1", "/client", ("ros2 token",)),
        Edge("add", "serves", "main", "z2", "/server", ("ros2 token",)),
    ]
    graph = Graph.of([], [Topic("add", "/add")], edges, [])
    found = take(log_with(tmp_path / "a.mcap", graph, "add/@request", "add/@reply")).graph()
    request, reply = (next(iter(found.components["/server"].inputs)), next(iter(found.components["/server"].outputs)))
    assert request != reply
    assert found.components["/client"] == ComponentTopics(frozenset({reply}), frozenset({request}), "recorded graph")


def test_damaged_records_are_told(tmp_path):
    with LogWriter(tmp_path / "a.mcap") as writer:
        writer.note(GRAPH, {"time": "1", "whole": "true", "gone": "{}", "new": "{}"})
    assert "the recorded graph is damaged" in take(tmp_path / "a.mcap").damaged[0]


@pytest.mark.parametrize("name", ["planner", "other"])
def test_a_recorded_graph_adds_writers_that_are_not_declared(name):
    first = TopicGraph({"planner": ComponentTopics(frozenset({"map"}), frozenset({"unit"}))})
    second = TopicGraph({name: ComponentTopics(frozenset({"goal"}), frozenset({"unit", "map"}), "recorded graph")})
    both = joined(first, second)
    assert list(both.writers("unit")) == ["planner"]
    assert [one.inputs for one in both.writers("map").values()] == [frozenset({"goal"})]
