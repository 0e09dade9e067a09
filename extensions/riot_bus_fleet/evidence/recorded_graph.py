"""Graphs of the topics that components read and write, from graphs recorded in logs; their trees and loops."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from riot_bus.backchain.graph import ComponentTopics, Hop, TopicGraph
from riot_bus.graph.history import replay
from riot_bus.log.layout import GRAPH
from riot_bus.types.serve import ERROR, REPLY, REQUEST
from riot_bus.vocabulary.errors import needs_extra

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from riot_bus.backchain.graph import TopicGraph
    from riot_bus.graph.model import Edge, Graph
    from riot_bus.log.reader import LogReader

RECORDED = "recorded graph"

_SAYS_IT_ALL = frozenset({"ros2 token", "bridge token", "declaration", "bridge"})
"""Evidence of components that announce everything they read and write; others show only in traffic."""


def joined(first: TopicGraph, second: TopicGraph) -> TopicGraph:
    """Return the first graph, with components of the second that write topics without a writer in the first."""
    written = frozenset().union(*(one.outputs for one in first.components.values()))
    more = {
        name if name not in first.components else f"{name} (recorded)": replace(one, outputs=one.outputs - written)
        for name, one in second.components.items()
        if one.outputs - written
    }
    return TopicGraph({**first.components, **more})


@dataclass(slots=True)
class _Part:
    inputs: set[str] = field(default_factory=set)
    outputs: set[str] = field(default_factory=set)
    told: bool = False


class RecordedComponents:
    """Components in the recorded graphs of several logs: those with the same name are one component."""

    def __init__(self) -> None:
        self._parts: defaultdict[str, _Part] = defaultdict(_Part)
        self.logs = 0
        self.damaged: list[str] = []

    def add(self, reader: LogReader) -> None:
        """Add the graphs of a log."""
        topics = {source.key: source.topic for source in reader.sources().values() if source.role == "delivered"}
        any_graph = False
        try:
            for _, graph in replay(reader.notes(GRAPH)):
                any_graph = True
                self._add_graph(graph, topics)
        except ValueError as error:
            self.damaged.append(f"{reader.path}: the recorded graph is damaged ({error})")
        self.logs += any_graph

    def graph(self) -> TopicGraph:
        """Return the topic graph; components that do not announce themselves are open."""
        return TopicGraph(
            {
                name: ComponentTopics(frozenset(one.inputs), frozenset(one.outputs), RECORDED, open=not one.told)
                for name, one in self._parts.items()
                if one.inputs or one.outputs
            }
        )

    def _add_graph(self, graph: Graph, topics: Mapping[str, str]) -> None:
        names = {topic.key: topics.get(topic.key, topic.name) for topic in graph.topics}
        behind: defaultdict[str, set[str]] = defaultdict(set)  # the nodes of each session
        for edge in graph.edges:
            if edge.zid and edge.node:
                behind[edge.zid].add(edge.node)
        for edge in graph.edges:
            if not edge.zid or "*" in edge.topic:
                continue  # unknown session; each key that a key expression matches has an edge of its own
            component = graph.component(edge.zid)
            label = component.label if component is not None else edge.zid[:8]
            # A link's messages go to all systems behind it; a session without a node acts for itself.
            for who in {edge.node} if edge.node else behind.get(edge.zid, set()) or {label}:
                part = self._parts[who]
                part.told = part.told or not _SAYS_IT_ALL.isdisjoint(edge.evidence)
                reads, writes = _topics_of(edge, names, topics)
                part.inputs |= reads
                part.outputs |= writes


def _topics_of(edge: Edge, names: Mapping[str, str], topics: Mapping[str, str]) -> tuple[set[str], set[str]]:
    """Return the topics that an edge's component reads and writes; for services, the parts that logs have."""
    if edge.role == "subscribes":
        return {names.get(edge.topic, edge.topic)}, set()
    if edge.role == "publishes":
        return set(), {names.get(edge.topic, edge.topic)}
    request = _recorded(edge.topic, (REQUEST,), topics)
    reply = _recorded(edge.topic, (REPLY, ERROR), topics)
    return (reply, request) if edge.role == "calls" else (request, reply)


def _recorded(key: str, parts: Collection[str], topics: Mapping[str, str]) -> set[str]:
    return {topics[f"{key}/{part}"] for part in parts if f"{key}/{part}" in topics}


_DEEPEST = 200
"""Most hops on one path of a tree; real systems have a tenth of that."""


def loops(graph: TopicGraph) -> list[tuple[str, ...]]:
    """Return the sets of topics that lead back to themselves, each sorted; raises MissingExtraError."""
    with needs_extra("scipy", "analysis"):
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
    components = graph.components.values()
    topics = sorted({topic for one in components for topic in (*one.inputs, *one.outputs)})
    if not topics:
        return []
    number = {topic: place for place, topic in enumerate(topics)}
    arrows = [(number[source], number[target]) for one in components for source in one.inputs for target in one.outputs]
    rows, columns = ([pair[end] for pair in arrows] for end in (0, 1))
    matrix = coo_array(([1.0] * len(arrows), (rows, columns)), shape=(len(topics), len(topics)))
    labels = connected_components(matrix, directed=True, connection="strong")[1].tolist()
    groups: dict[int, list[str]] = {}
    for topic, label in zip(topics, labels, strict=True):
        groups.setdefault(label, []).append(topic)
    alone = {source for source, target in arrows if source == target}
    return [tuple(one) for one in groups.values() if len(one) > 1 or number[one[0]] in alone]


def tree_once(graph: TopicGraph, root: str, externals: Collection[str]) -> Hop:
    """Return the tree of paths from a topic back to the externals that follows each topic only once.

    That is at its place nearest to the root; elsewhere it is marked `again`. Branches that reach no external topic are
    left out, and paths end at the first external topic.
    """
    useful = frozenset[str]().union(*map(graph.reached, externals))
    following: dict[str, list[tuple[str, str]]] = {}
    owner: dict[str, tuple[str, str] | None] = {root: None}
    ahead = [root]
    for topic in ahead:  # grows: topics by their distance from the root
        following[topic] = []
        if topic not in externals or topic == root:
            following[topic] = [one for one in graph.next(topic, forward=False) if one[1] in useful]
        for name, other in following[topic]:
            if other not in owner:
                owner[other] = (topic, name)
                ahead.append(other)

    def grow(topic: str, component: str | None, path: frozenset[str]) -> Hop:
        hops = []
        for name, other in following[topic]:
            external = other in externals
            if other in path or other == topic:
                hops.append(Hop(other, name, external, loop=True))
            elif len(path) >= _DEEPEST:
                hops.append(Hop(other, name, external, cut=True))
            elif external or owner[other] == (topic, name):
                hops.append(grow(other, name, path | {topic}))
            else:
                hops.append(Hop(other, name, external, again=bool(following[other])))
        return Hop(topic, component, topic in externals, hops=tuple(hops))

    return grow(root, None, frozenset())
