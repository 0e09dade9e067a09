from __future__ import annotations

import json

import pytest

from riot_bus.graph.history import graph_from, record, replay
from riot_bus.graph.model import ConnectedComponent, Edge, Graph, Topic, Unknown
from riot_bus.graph.render import graph_json, render

A = Graph.of(
    [ConnectedComponent("unit", "a1", "client", addresses=("tcp/127.0.0.1:1",), pid=3)],
    [Topic("cut/x", "cut/x", intercepted=True)],
    [Edge("cut/x", "publishes", "unit", "a1", evidence=("traffic",), messages=3)],
    [Unknown("a1", "unit", "text")],
)
B = Graph.of([*A.components, ConnectedComponent("system", "b2")], A.topics, [], [])


def test_graphs_come_back_from_the_records_of_a_log() -> None:
    records = [record(None, A, time=1), record(A, B, time=2), record(B, Graph(), time=3), record(None, B, time=4)]
    assert list(replay(records)) == [(1, A), (2, B), (3, Graph()), (4, B)]
    assert records[1]["whole"] == "false"
    assert "a1" not in records[1]["new"]  # what stays is not told again


def test_a_graph_comes_back_from_json() -> None:
    assert graph_from(json.loads(graph_json(A))) == A
    assert graph_from({**json.loads(graph_json(A)), "news": 1}) == A
    with pytest.raises(ValueError, match="version 2"):
        graph_from({"version": 2})


def test_damaged_records_are_an_error() -> None:
    good = record(None, A, time=1)
    odd = [{"version": 1, "topics": rows} for rows in ([1], 1, [{"name": {}}], [{"name": [{}]}], [[]])]
    texts = ["{", "[]", "1", "[" * 100_000, *map(json.dumps, odd)]
    for damaged in ({}, {**good, "time": "x"}, *({**good, "new": text} for text in texts)):
        with pytest.raises(ValueError, match=r".+"):
            list(replay([damaged]))


@pytest.mark.parametrize("form", ["text", "json", "mermaid", "dot"])
def test_each_format_has_the_topic(form: str) -> None:
    assert "cut/x" in render(A, form)
