"""Graphs as text, JSON, Mermaid and DOT; pure. Names come from the network and are escaped as each format requires."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

from riot_bus.graph.folding import folded, names
from riot_bus.graph.model import CALL_ROLES
from riot_bus.vocabulary.redaction import escape_control_chars as _plain

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from riot_bus.graph.model import ConnectedComponent, Edge, Graph, GraphChange

__all__ = ["VERSION", "changes_json", "dot", "graph_json", "mermaid", "render", "text"]

VERSION = 1
"""Version of the JSON format."""

_OUTWARDS = ("publishes", "calls")


def render(graph: Graph, form: str, *, indent: int | None = None) -> str:
    """Return the graph as `text`, `json`, `mermaid` or `dot`.

    Args:
        graph: The graph.
        form: One of these names.
        indent: For JSON: spaces per level; None for one line.
    """
    if form == "json":
        return graph_json(graph, indent=indent)
    return {"text": text, "mermaid": mermaid, "dot": dot}[form](graph)


def graph_json(graph: Graph, *, indent: int | None = None) -> str:
    """Return the graph as JSON: `version`, `components`, `topics`, `edges`, `unknown`.

    Args:
        graph: The graph.
        indent: Spaces per level; None for one line.
    """
    return json.dumps({"version": VERSION, **asdict(graph)}, indent=indent, sort_keys=True)


def changes_json(graph: Graph, changes: Sequence[GraphChange], *, time: int) -> str:
    """Return one change of a graph, and the graph after it, as one line of JSON for a log.

    Args:
        graph: The new graph.
        changes: Differences from the graph before.
        time: Time in nanoseconds since the Unix epoch.
    """
    record = {"version": VERSION, "time": time, "changes": [asdict(each) for each in changes], "graph": asdict(graph)}
    return json.dumps(record, sort_keys=True)


def text(graph: Graph) -> str:
    """Return the graph in columns; an action is one topic."""
    about, graph = names(graph.topics), folded(graph)
    components = [
        (
            _plain(c.segment) or "-",
            _plain(c.label),
            c.mode or "-",
            _plain(c.zid)[:8],
            str(c.pid or "-"),
            _ends(c),
        )
        for c in graph.components
    ]
    topics, called = {topic.key: topic for topic in graph.topics}, names(graph.topics)
    edges = []
    for edge in graph.edges:
        topic = topics.get(edge.topic)
        name = called.get(edge.topic, edge.topic)
        count = f"{edge.messages} ({edge.rate:.1f}/s)" if edge.messages else ""
        cut = "yes" if topic is not None and topic.intercepted else ""
        who = (
            _plain(_who(graph, edge)),
            edge.role,
            _plain(name),
            _plain(topic.type_name if topic else ""),
        )
        edges.append((_plain(edge.segment) or "-", *who, cut, count, ", ".join(edge.evidence)))
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
    drawing = _Drawing(graph)
    lines = ["flowchart LR"]
    for number, (segment, nodes) in enumerate(drawing.segments()):
        if segment:
            lines.append(f'  subgraph s{number}["{_html(segment)}"]')
        lines += [f'    {node}["{_html(label)}"]' for node, label in nodes]
        if segment:
            lines.append("  end")
    for node, label, asked, cut in drawing.topics():
        lines.append(f'  {node}{{{{"{_html(label)}"}}}}' if asked else f'  {node}(["{_html(label)}"])')
        if cut:
            lines.append(f"  style {node} stroke-width:4px")
    lines += [f"  {source} --> {target}" for source, target in drawing.arrows()]
    return "\n".join(lines) + "\n"


def dot(graph: Graph) -> str:
    """Return the graph in Graphviz's language: components are boxes in their segments, topics are ellipses.

    Services and actions are hexagons; what is intercepted has a thick border.
    """
    drawing = _Drawing(graph)
    lines = ["digraph riot {", "  rankdir=LR;"]
    for number, (segment, nodes) in enumerate(drawing.segments()):
        if segment:
            lines.append(f"  subgraph cluster_{number} {{ label={_quoted(segment)};")
        lines += [f"    {node} [shape=box, label={_quoted(label)}];" for node, label in nodes]
        if segment:
            lines.append("  }")
    for node, label, asked, cut in drawing.topics():
        border = ", penwidth=3" if cut else ""
        lines.append(f"  {node} [shape={'hexagon' if asked else 'ellipse'}, label={_quoted(label)}{border}];")
    lines += [f"  {source} -> {target};" for source, target in drawing.arrows()]
    return "\n".join([*lines, "}"]) + "\n"


class _Drawing:
    """Nodes under made-up ids, so that no name is ever read as syntax."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph = folded(graph)
        self._topic = {topic.key: f"t{number}" for number, topic in enumerate(graph.topics)}
        self._node: dict[tuple[str, str], str] = {}
        self._labels: dict[tuple[str, str], str] = {}
        for component in graph.components:
            self._add((component.segment, component.zid), component.label)
        for edge in graph.edges:
            self._add((edge.segment, edge.zid), _who(graph, edge))

    def _add(self, who: tuple[str, str], label: str) -> None:
        if who not in self._node:
            self._node[who] = f"c{len(self._node)}"
            self._labels[who] = label

    def segments(self) -> list[tuple[str, list[tuple[str, str]]]]:
        names = sorted({segment for segment, _ in self._node})
        return [(n, [(self._node[w], self._labels[w]) for w in self._node if w[0] == n]) for n in names]

    def topics(self) -> list[tuple[str, str, bool, bool]]:
        """Return id, label, whether it is a service or action, and whether it is intercepted."""
        called = names(self.graph.topics)
        asked = {edge.topic for edge in self.graph.edges if edge.role in CALL_ROLES}
        return [(self._topic[t.key], called[t.key], t.key in asked, t.intercepted) for t in self.graph.topics]

    def arrows(self) -> list[tuple[str, str]]:
        arrows: dict[tuple[str, str], None] = {}
        for edge in self.graph.edges:
            topic, node = self._topic.get(edge.topic), self._node[edge.segment, edge.zid]
            if topic is not None:
                arrows[(node, topic) if edge.role in _OUTWARDS else (topic, node)] = None
        return list(arrows)


def _who(graph: Graph, edge: Edge) -> str:
    if not edge.zid:
        what = "source" if edge.role in _OUTWARDS else "receiver"
        return f"unknown {what} in segment {edge.segment}" if edge.segment else f"unknown {what}"
    component = graph.component(edge.zid, edge.segment)
    return edge.node or (component.label if component is not None else edge.zid[:8])


def _ends(component: ConnectedComponent) -> str:
    return _plain(", ".join(component.addresses)) or "-"


def _columns(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    table = [head, *rows]
    if len(table) == 1:
        return ""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in table)


def _html(name: str) -> str:
    """Write all but letters, digits and a few signs as Mermaid's entities `#code;`."""
    return "".join(each if each.isalnum() or each in " /_-.,:@" else f"#{ord(each)};" for each in _plain(name))


def _quoted(name: str) -> str:
    escaped = _plain(name).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
