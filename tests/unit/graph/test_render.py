from __future__ import annotations

import json
import re

from riot_bus.graph.model import ConnectedComponent, Edge, Graph, Topic, Unknown
from riot_bus.graph.render import dot, graph_json, mermaid, text

EVIL = 'a"]; end --> x{}\\"<b>\n\x1b[31m#quot;`|'

GRAPH = Graph.of(
    [
        ConnectedComponent("out", "aa11", "client", name="sim", addresses=("tcp/127.0.0.1:5",), pid=17),
        ConnectedComponent("in", "bb22", "peer", nodes=("/planner",)),
    ],
    [Topic("cmd", "cmd", "json", intercepted=True)],
    [
        Edge("cmd", "publishes", "out", "aa11", evidence=("traffic",), messages=12, rate=2.5),
        Edge("cmd", "subscribes", "in", "bb22", "/planner", evidence=("ros2 token",)),
        Edge("cmd", "publishes", "in", evidence=("traffic",)),
    ],
    [Unknown("cmd", "in", "unknown source in segment in: none of 1 components declares it")],
)
HOSTILE = Graph.of(
    [ConnectedComponent(EVIL, EVIL, name=EVIL)], [Topic(EVIL, EVIL)], [Edge(EVIL, "publishes", EVIL, EVIL)], []
)


def test_text_has_columns() -> None:
    assert text(GRAPH) == (
        "SEGMENT  COMPONENT  MODE    ID    PID  ADDRESS\n"
        "in       /planner   peer    bb22  -    -\n"
        "out      sim        client  aa11  17   tcp/127.0.0.1:5\n"
        "\n"
        "SEGMENT  COMPONENT                     ROLE        TOPIC  TYPE  INTERCEPTED  MESSAGES    EVIDENCE\n"
        "in       unknown source in segment in  publishes   cmd    json  yes                      traffic\n"
        "out      sim                           publishes   cmd    json  yes          12 (2.5/s)  traffic\n"
        "in       /planner                      subscribes  cmd    json  yes                      ros2 token\n"
        "\n"
        "NOT KNOWN\n"
        "cmd        unknown source in segment in: none of 1 components declares it\n"
    )
    assert text(Graph()) == "\n"
    assert "\x1b" not in text(HOSTILE)


def test_json_is_versioned_and_stable() -> None:
    found = json.loads(graph_json(GRAPH))
    assert found["version"] == 1
    assert set(found) == {"version", "components", "topics", "edges", "unknown"}
    assert found["edges"][0]["evidence"] == ["traffic"]
    assert graph_json(GRAPH) == graph_json(
        Graph.of(reversed(GRAPH.components), GRAPH.topics, GRAPH.edges, GRAPH.unknown)
    )
    assert "\n" not in graph_json(GRAPH)
    assert json.loads(graph_json(HOSTILE))["components"][0]["name"] == EVIL


def test_mermaid_draws_segments_topics_and_arrows() -> None:
    assert mermaid(GRAPH) == (
        "flowchart LR\n"
        '  subgraph s0["in"]\n'
        '    c0["/planner"]\n'
        '    c2["unknown source in segment in"]\n'
        "  end\n"
        '  subgraph s1["out"]\n'
        '    c1["sim"]\n'
        "  end\n"
        '  t0(["cmd"])\n'
        "  style t0 stroke-width:4px\n"
        "  c2 --> t0\n"
        "  c1 --> t0\n"
        "  t0 --> c0\n"
    )


def test_no_name_is_read_as_syntax() -> None:
    labels = re.findall(r'"([^"]*)"', mermaid(HOSTILE))
    assert len(labels) == 3
    for label in labels:
        assert re.fullmatch(r"(?:[\w /\-.,:@]|#\d+;)*", label)
    drawn = dot(HOSTILE)
    assert drawn.count("\n") == 8
    assert not re.search(r"[\x00-\x08\x1b]", drawn)
    without = re.sub(r'"(?:[^"\\]|\\.)*"', "Q", drawn)
    assert '"' not in without
    assert "end" not in without


def test_dot_draws_the_same() -> None:
    drawn = dot(GRAPH)
    assert drawn.startswith("digraph riot {\n")
    assert '  subgraph cluster_0 { label="in";\n' in drawn
    assert '  t0 [shape=ellipse, label="cmd", penwidth=3];\n' in drawn
    assert "  c1 -> t0;\n" in drawn
