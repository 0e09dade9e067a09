"""Topics between the external and the relevant fields: choice of their fields, and the most permeable paths."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice, zip_longest
from typing import Any

from riot_bus.backchain.graph import TopicGraph
from riot_bus.campaign.targets import targets_of
from riot_bus.chain.base.external import message_rate
from riot_bus.chain.base.logs import nominal_values
from riot_bus.chain.base.workspace import Workspace
from riot_bus.findings.permeability import EdgeRecord, PathRecord, StageRecord
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.selector import parse_selector

_PER_TOPIC, _MOST = 3, 48
"""Most fields per topic, and in total: each costs a read for each message of a run, and an analysis."""
_LARGEST, _MOST_MESSAGES = 16 << 10, 10_000
"""Largest bytes of a message, and messages of a topic in a run: a whole run is in memory, so topics with more, such as
images, are left out."""


def intermediate_fields(
    workspace: Workspace, graph: TopicGraph, topics: Iterable[str], externals: Iterable[str]
) -> tuple[str, ...]:
    """Return numeric fields on topics between external and internal ones, those that vary most in the nominal log."""
    inside, outside = set(topics), set(externals)
    before = {one for topic in inside for one in graph.reaching(topic)}
    behind = {one for topic in outside for one in graph.reached(topic)}
    between = (before & behind) - inside - outside
    registry = workspace.context.registry
    carried: dict[str, list[Message]] = {}
    for message in workspace.nominal_messages():
        if (topic := registry.topic(message.key)) in between:
            carried.setdefault(topic, []).append(message)
    messages = [one for some in carried.values() if _are_few(some, workspace) for one in some]
    paths = {
        topic: [one.path for one in some if _can_be_observed(topic, one.path)][:64]
        for topic, some in targets_of(messages, registry).items()
    }
    values = nominal_values(messages, paths, registry=registry, at_most=100)
    chosen = []
    for topic, some in sorted(paths.items()):
        distinct = {f"{topic}:{path}": _different_numbers(values[f"{topic}:{path}"]) for path in some}
        varying = sorted((name for name, count in distinct.items() if count > 1), key=lambda one: -distinct[one])
        chosen.append(varying[:_PER_TOPIC])
    in_turns = filter(None, chain.from_iterable(zip_longest(*chosen)))  # so that each topic has one first
    return tuple(islice(in_turns, _MOST))


def _are_few(messages: Sequence[Message], workspace: Workspace) -> bool:
    """Return whether a topic's messages in a run fit into memory, and none of them is large."""
    system = workspace.context.file.system
    rate = message_rate(one.time for one in messages) / system.nominal_run.speed
    few = max(len(messages), rate * system.perturbed_run.duration) <= _MOST_MESSAGES
    return few and all(len(one.payload) <= _LARGEST for one in messages)


def _can_be_observed(topic: str, path: str) -> bool:
    """Return whether a selector can name a field: keys of JSON may be any text."""
    try:
        selector = parse_selector(f"{topic}:{path}")
    except ConfigError:
        return False
    return (selector.topic, selector.field, selector.where) == (topic, path, None)


def _different_numbers(values: Sequence[Scalar]) -> int:
    """Return how many different values a field has; 0 if some value is not a finite number."""
    numbers = [value for value in values if isinstance(value, (int, float)) and math.isfinite(value)]
    return len(set(numbers)) if len(numbers) == len(values) else 0


def with_strengths(tree: dict[str, Any], edges: Iterable[EdgeRecord]) -> dict[str, Any]:
    """Return a backtrack tree with the field of each topic that follows an external field most.

    Returns:
        The tree; each node has `follows` (an edge as data; None if no field of the topic was tested).
    """
    best = {_topic_of(edge): edge for edge in sorted(edges, key=_shown)}

    def marked(node: dict[str, Any]) -> dict[str, Any]:
        edge = None if node["external"] else best.get(node["topic"])
        follows = edge and edge.model_dump(
            mode="json", include={"external", "internal", "permeable", "strength", "low", "high"}
        )
        return node | {"follows": follows, "hops": [marked(hop) for hop in node["hops"]]}

    return marked(tree)


def most_permeable_paths(trees: Sequence[Mapping[str, Any]], edges: Iterable[EdgeRecord]) -> tuple[PathRecord, ...]:
    """Return for each root the path from an external field whose weakest topic is strongest.

    The strength of a topic is the share of its strongest field that follows the external one. A path counts only if
    the strength of each of its topics is known and not 0; there may be none.
    """
    known = {(edge.external, _topic_of(edge)): edge for edge in sorted(edges, key=_shown)}
    sources: dict[str, dict[str, None]] = {}
    for external, _ in known:
        sources.setdefault(external.rpartition(":")[0], {})[external] = None
    found = []
    for tree in trees:
        best: tuple[float, int, list[EdgeRecord]] = (0.0, 0, [])
        unknown = 0
        for topics in _ways(tree):
            for external in sources.get(topics[0], ()):
                steps = [known.get((external, topic)) for topic in topics[1:]]
                looked_at = [edge for edge in steps if edge is not None]
                weakest = min(map(_shown, looked_at), default=0.0)
                if not weakest or steps[-1] is None:
                    continue
                if len(looked_at) < len(steps):
                    unknown += 1
                elif (weakest, -len(steps)) > best[:2] or not best[2]:
                    best = weakest, -len(steps), looked_at
        if best[2]:
            stages = [
                StageRecord(topic=_topic_of(edge), field=edge.internal, strength=edge.strength) for edge in best[2]
            ]
            found.append(PathRecord(external=best[2][0].external, stages=tuple(stages), unknown=unknown))
    return tuple(found)


def _ways(tree: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield the topics of each path of a tree, from an external one other than the root's topic to the root."""
    branches: list[tuple[Mapping[str, Any], tuple[str, ...]]] = [(tree, ())]
    while branches:
        node, behind = branches.pop()
        topics = (node["topic"], *behind)
        if node["external"] and behind and node["topic"] != tree["topic"]:
            yield topics
        branches += [(hop, topics) for hop in node["hops"]]


def _topic_of(edge: EdgeRecord) -> str:
    """Return the topic of the field that follows."""
    return edge.internal.rpartition(":")[0]


def _shown(edge: EdgeRecord) -> float:
    """Return the strength of an edge; 0 if it may be chance."""
    return edge.strength if edge.permeable else 0.0
