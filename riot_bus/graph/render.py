"""Graphs as text, JSON, Mermaid and DOT; pure. Names come from the network and are escaped as each format requires."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from riot_bus.graph.folding import folded, names
from riot_bus.graph.model import CALL_ROLES, Edge, Graph
from riot_bus.vocabulary.redaction import escape_control_chars as _plain
from riot_bus.vocabulary.text_table import table_lines

VERSION = 1
"""Version of the JSON format."""

_OUTWARDS = ("publishes", "calls")


def render(graph: Graph, form: str, *, indent: int | None = None) -> str:
    """Return the graph as `text`, `json`, `mermaid` or `dot`."""
    if form == "json":
        return graph_json(graph, indent=indent)
    return {"text": text, "mermaid": mermaid, "dot": dot}[form](graph)


def graph_json(graph: Graph, *, indent: int | None = None) -> str:
    """Return the graph as JSON: `version`, `components`, `topics`, `edges`, `unknown`."""
    return json.dumps({"version": VERSION, **asdict(graph)}, indent=indent, sort_keys=True)


def text(graph: Graph) -> str:
    """Return the graph in columns; an action is one topic."""
    about, graph = names(graph.topics), folded(graph)
    components = []
    for one in graph.components:
        ends, pid = _plain(", ".join(one.addresses)) or "-", str(one.pid or "-")
        row = (_plain(one.segment) or "-", _plain(one.label), one.mode or "-", _plain(one.zid)[:8], pid, ends)
        components.append(row)
    topics, called = {topic.key: topic for topic in graph.topics}, names(graph.topics)
    edges = []
    for edge in graph.edges:
        topic = topics.get(edge.topic)
        name = called.get(edge.topic, edge.topic)
        count = f"{edge.messages} ({edge.rate:.1f}/s)" if edge.messages else ""
        cut = "yes" if topic is not None and topic.intercepted else ""
        who, type_name = _plain(_who(graph, edge)), _plain(topic.type_name if topic else "")
        facts = (edge.role, _plain(name), type_name, cut, count, ", ".join(edge.evidence))
        edges.append((_plain(edge.segment) or "-", who, *facts))
    unknown = [(_plain(about.get(each.about, each.about)) or "-", _plain(each.text)) for each in graph.unknown]
    blocks = [
        _columns(("SEGMENT", "COMPONENT", "MODE", "ID", "PID", "ADDRESS"), components),
        _columns(("SEGMENT", "COMPONENT", "ROLE", "TOPIC", "TYPE", "INTERCEPTED", "MESSAGES", "EVIDENCE"), edges),
        _columns(("NOT KNOWN", ""), unknown),
    ]
    return "\n\n".join(filter(None, blocks)) + "\n"


def mermaid(graph: Graph) -> str:
    """Return the graph as a Mermaid flowchart: components are boxes in their segments, topics are round.

    Services and actions are hexagons; what is intercepted has a thick border.
    """
    return _drawn(graph, _MERMAID)


def dot(graph: Graph) -> str:
    """Return the graph in Graphviz's language: components are boxes in their segments, topics are ellipses."""
    return _drawn(graph, _DOT)


@dataclass(frozen=True, slots=True)
class _Language:
    """Lines of a language for drawings; `label` turns an untrusted name into one that is no syntax."""

    label: Callable[[str], str]
    begin: str
    segment: str
    segment_end: str
    component: str
    topic: str
    call: str
    thick: str
    arrow: str
    end: str


def _drawn(graph: Graph, language: _Language) -> str:
    """Return a drawing, in which nodes have made-up ids, so that no name is ever read as syntax."""
    graph, label = folded(graph), language.label
    components: dict[tuple[str, str], str] = {(each.segment, each.zid): each.label for each in graph.components}
    for edge in graph.edges:
        components.setdefault((edge.segment, edge.zid), _who(graph, edge))
    nodes = {who: f"c{number}" for number, who in enumerate(components)}
    topics = {topic.key: f"t{number}" for number, topic in enumerate(graph.topics)}
    lines = [language.begin]
    for number, segment in enumerate(sorted({segment for segment, _ in components})):
        inside = [language.component.format(nodes[who], label(components[who])) for who in nodes if who[0] == segment]
        outline = (language.segment.format(number, label(segment)), language.segment_end)
        lines += [outline[0], *inside, outline[1]] if segment else inside
    called, asked = names(graph.topics), {edge.topic for edge in graph.edges if edge.role in CALL_ROLES}
    for topic in graph.topics:
        thick = language.thick.format(topics[topic.key]) if topic.intercepted else ""
        shape = language.call if topic.key in asked else language.topic
        lines.append(shape.format(topics[topic.key], label(called[topic.key]), thick))
    arrows: dict[tuple[str, str], None] = {}
    for edge in graph.edges:
        if edge.topic in topics:
            ends = nodes[edge.segment, edge.zid], topics[edge.topic]
            arrows[ends if edge.role in _OUTWARDS else ends[::-1]] = None
    lines += [language.arrow.format(*ends) for ends in arrows]
    return "\n".join([*lines, language.end]).rstrip("\n") + "\n"


def _who(graph: Graph, edge: Edge) -> str:
    if not edge.zid:
        what = "source" if edge.role in _OUTWARDS else "receiver"
        return f"unknown {what} in segment {edge.segment}" if edge.segment else f"unknown {what}"
    component = graph.component(edge.zid, edge.segment)
    return edge.node or (component.label if component is not None else edge.zid[:8])


def _columns(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    return "\n".join(table_lines([head, *rows], left=range(len(head)))) if rows else ""


def _html(name: str) -> str:
    """Write all but letters, digits and a few signs as Mermaid's entities `#code;`."""
    return "".join(each if each.isalnum() or each in " /_-.,:@" else f"#{ord(each)};" for each in _plain(name))


def _quoted(name: str) -> str:
    escaped = _plain(name).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


_MERMAID = _Language(
    label=_html,
    begin="flowchart LR",
    segment='  subgraph s{}["{}"]',
    segment_end="  end",
    component='    {}["{}"]',
    topic='  {}(["{}"]){}',
    call='  {}{{{{"{}"}}}}{}',
    thick="\n  style {} stroke-width:4px",
    arrow="  {} --> {}",
    end="",
)
_DOT = _Language(
    label=_quoted,
    begin="digraph riot {\n  rankdir=LR;",
    segment="  subgraph cluster_{} {{ label={};",
    segment_end="  }",
    component="    {} [shape=box, label={}];",
    topic="  {} [shape=ellipse, label={}{}];",
    call="  {} [shape=hexagon, label={}{}];",
    thick=", penwidth=3",
    arrow="  {} -> {};",
    end="}",
)
