"""A graph as people want to see it: actions as one topic instead of five, and unambiguous names; pure."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING

from riot_bus.graph.model import CALL_ROLES, Edge, Graph, Topic

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from riot_bus.types.capabilities import Role

_BELOW = "/_action/"


def folded(graph: Graph) -> Graph:
    """Return the graph with one topic for each action, instead of its topics and services.

    A component that serves one of its services serves the action, and one that calls one calls it; that these also
    publish and subscribe to feedback and status is not shown separately.
    """
    actions = {topic.key: topic.key.partition(_BELOW)[0] for topic in graph.topics if topic.action}
    if not actions:
        return graph
    topics: dict[str, Topic] = {}
    for topic in graph.topics:
        key = actions.get(topic.key)
        if key is None:
            topics[topic.key] = topic
            continue
        known = topics.get(key, topic)
        type_name = topic.action_type or known.action_type
        intercepted = topic.intercepted or known.intercepted
        topics[key] = Topic(key, topic.action, type_name, intercepted, topic.action, type_name)
    edges = [edge for edge in graph.edges if edge.topic not in actions]
    grouped: defaultdict[tuple[str, str, str, str], list[Edge]] = defaultdict(list)
    for edge in graph.edges:
        if edge.topic in actions:
            grouped[actions[edge.topic], edge.segment, edge.zid, edge.node].append(edge)
    for (key, *_), parts in grouped.items():
        edges += _of_one(key, parts)
    return Graph.of(graph.components, topics.values(), edges, graph.unknown)


def _of_one(key: str, parts: list[Edge]) -> Iterator[Edge]:
    """Yield the edges between one component and an action."""
    present = {each.role for each in parts}
    roles = [role for role in CALL_ROLES if role in present]
    if roles and parts[0].zid:
        yield _joined(key, roles[0], parts)
        yield from (_joined(key, role, [e for e in parts if e.role == role]) for role in roles[1:])
        return
    for role in sorted(present):
        yield _joined(key, role, [each for each in parts if each.role == role])


def _joined(key: str, role: Role, parts: list[Edge]) -> Edge:
    return replace(
        parts[0],
        topic=key,
        role=role,
        evidence=tuple(sorted({each for part in parts for each in part.evidence})),
        messages=sum(part.messages for part in parts),
        rate=sum(part.rate for part in parts),
    )


def names(topics: Iterable[Topic]) -> dict[str, str]:
    """Return a unique name for each key: its name, followed by the key if several keys have the same name."""
    all_topics = list(topics)
    count = Counter(topic.name for topic in all_topics)
    return {topic.key: topic.name if count[topic.name] == 1 else f"{topic.name} ({topic.key})" for topic in all_topics}
