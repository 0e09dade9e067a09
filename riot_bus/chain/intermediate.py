"""Topics between the outside and the relevant fields: what is looked at of them, and the most permeable paths."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from riot_bus.campaign.targets import targets_of
from riot_bus.chain.logs import nominal_values
from riot_bus.findings.permeability import PathRecord, StageRecord

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from riot_bus.backchain.graph import TopicGraph
    from riot_bus.chain.workspace import Workspace
    from riot_bus.findings.permeability import EdgeRecord
    from riot_bus.vocabulary.message import Scalar

__all__ = ["intermediate_fields", "most_permeable_paths", "with_strengths"]

_PER_TOPIC, _MOST = 3, 60
"""Fields that are looked at of a topic, and of all: each costs a read for each message of a run."""
_LARGEST = 16 << 10
"""Bytes of a message; all of a run are in memory, so topics with larger ones, such as images, are not looked at."""


def intermediate_fields(
    workspace: Workspace, graph: TopicGraph, topics: Iterable[str], externals: Iterable[str]
) -> tuple[str, ...]:
    """Return numbers on topics that lie between the outside and some topics, those that vary most in the nominal log.

    Args:
        workspace: The system.
        graph: Who reads and writes what.
        topics: The topics inside; they are none that lie between.
        externals: The topics that the outside controls, likewise.
    """
    inside, outside = set(topics), set(externals)
    before = {one for topic in inside for one in graph.reaching(topic)}
    behind = {one for topic in outside for one in graph.reached(topic)}
    between = (before & behind) - inside - outside
    registry = workspace.context.registry
    messages = [one for one in workspace.nominal_messages() if registry.topic(one.key) in between]
    large = {registry.topic(one.key) for one in messages if len(one.payload) > _LARGEST}
    messages = [one for one in messages if registry.topic(one.key) not in large]
    paths = {topic: [one.path for one in some] for topic, some in targets_of(messages, registry).items()}
    values = nominal_values(messages, paths, registry=registry)
    found: list[str] = []
    for topic, some in sorted(paths.items()):
        distinct = {f"{topic}:{path}": _different_numbers(values[f"{topic}:{path}"]) for path in some}
        varying = sorted((name for name, count in distinct.items() if count > 1), key=lambda one: -distinct[one])
        found += varying[:_PER_TOPIC]
    return tuple(found[:_MOST])


def _different_numbers(values: Sequence[Scalar]) -> int:
    """Return how many different values a field has; 0 if some is no finite number."""
    numbers = [value for value in values if isinstance(value, (int, float)) and math.isfinite(value)]
    return len(set(numbers)) if len(numbers) == len(values) else 0


def with_strengths(tree: dict[str, Any], edges: Iterable[EdgeRecord]) -> dict[str, Any]:
    """Return a backtrack tree in which each topic says what of it follows an external field most.

    Args:
        tree: As `Hop.as_json` returns it.
        edges: What is known of fields of its topics.

    Returns:
        The tree; each node has `follows` (an edge as data, None where no field of the topic was looked at).
    """
    best: dict[str, EdgeRecord] = {}
    for edge in edges:
        topic = edge.internal.rpartition(":")[0]
        if topic not in best or _shown(edge) > _shown(best[topic]):
            best[topic] = edge

    def marked(node: dict[str, Any]) -> dict[str, Any]:
        edge = None if node["external"] else best.get(node["topic"])
        follows = edge and edge.model_dump(
            mode="json", include={"external", "internal", "permeable", "strength", "low", "high"}
        )
        return node | {"follows": follows, "hops": [marked(hop) for hop in node["hops"]]}

    return marked(tree)


def most_permeable_paths(trees: Sequence[Mapping[str, Any]], edges: Iterable[EdgeRecord]) -> tuple[PathRecord, ...]:
    """Return for each root the path from an external field on which most of it gets through where it is weakest.

    What is known of a topic is the share of its strongest field that follows the external one; a topic of which no
    field was looked at does not count. There is none to a root that no external field reaches.

    Args:
        trees: Backtrack trees, as `Hop.as_json` returns them.
        edges: What is known of fields of their topics.
    """
    known: dict[tuple[str, str], EdgeRecord] = {}
    for edge in edges:
        pair = edge.external, edge.internal.rpartition(":")[0]
        if pair not in known or _shown(edge) > _shown(known[pair]):
            known[pair] = edge
    sources: dict[str, list[str]] = {}
    for external, _ in known:
        if external not in (some := sources.setdefault(external.rpartition(":")[0], [])):
            some.append(external)
    found = []
    for tree in trees:
        candidates = [
            path
            for topics in _ways(tree)
            for external in sources.get(topics[0], ())
            if (end := known.get((external, topics[-1]))) is not None and end.permeable
            if (path := _path(external, topics[1:], known)) is not None
        ]
        if candidates:
            found.append(max(candidates, key=_rank))
    return tuple(found)


def _path(external: str, topics: Sequence[str], known: Mapping[tuple[str, str], EdgeRecord]) -> PathRecord:
    stages = []
    for topic in topics:
        edge = known.get((external, topic))
        stages.append(
            StageRecord(topic=topic, field=edge and edge.internal, strength=None if edge is None else _shown(edge))
        )
    return PathRecord(external=external, stages=tuple(stages))


def _rank(path: PathRecord) -> tuple[float, int, int]:
    measured = [one.strength for one in path.stages if one.strength is not None]
    return min(measured, default=0.0), len(measured) - len(path.stages), -len(path.stages)


def _ways(tree: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield the topics of each path of a tree, from an external one to the root."""
    waiting: list[tuple[Mapping[str, Any], tuple[str, ...]]] = [(tree, ())]
    while waiting:
        node, behind = waiting.pop()
        topics = (node["topic"], *behind)
        if node["external"] and behind:
            yield topics
        waiting += [(hop, topics) for hop in node["hops"]]


def _shown(edge: EdgeRecord) -> float:
    """Return the share that follows, 0 if that may be chance."""
    return edge.strength if edge.permeable else 0.0
