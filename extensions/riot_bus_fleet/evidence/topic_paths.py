"""Trees of topics that name each topic's sources once, and loops, for large graphs of topics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.backchain.graph import Hop
from riot_bus.vocabulary.errors import needs_extra

if TYPE_CHECKING:
    from collections.abc import Collection

    from riot_bus.backchain.graph import TopicGraph

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
