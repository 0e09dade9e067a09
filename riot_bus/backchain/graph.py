"""Topic graphs, and the backtrack trees of external topics that can reach an internal one (RIOT II-C, after Hiller)."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields
from typing import Any


@dataclass(frozen=True, slots=True)
class ComponentTopics:
    """The topics that one component reads and writes.

    Attributes:
        told: Source of this, such as `riot.toml` or `recorded graph`; `inferred` if there is none.
        open: Whether it may read more than is known.
    """

    inputs: frozenset[str] = frozenset()
    outputs: frozenset[str] = frozenset()
    told: str = "riot.toml"
    open: bool = False


@dataclass(frozen=True, slots=True)
class Hop:
    """A topic in a tree, and the topics one component further on.

    Attributes:
        component: Component that connects it to its parent in the tree; None at the root.
        loop: Whether it is already on the path from the root; it is not followed again.
        cut: Whether it is not followed because the tree was too large.
        again: Whether its next hops are elsewhere in the tree.
    """

    topic: str
    component: str | None = None
    external: bool = False
    loop: bool = False
    cut: bool = False
    again: bool = False
    hops: tuple[Hop, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the tree as nested dicts and lists."""
        own = {each.name: getattr(self, each.name) for each in fields(self)}
        return own | {"hops": [hop.as_json() for hop in self.hops]}


@dataclass(frozen=True, slots=True)
class TopicGraph:
    """Components and the topics between them."""

    components: Mapping[str, ComponentTopics] = field(default_factory=dict)

    def reaching(self, topic: str) -> frozenset[str]:
        """Return every topic from which some path of components leads to `topic`, and `topic` itself."""
        return self._closure(topic, forward=False)

    def reached(self, topic: str) -> frozenset[str]:
        """Return every topic to which some path of components leads from `topic`, and `topic` itself."""
        return self._closure(topic, forward=True)

    def writers(self, topic: str) -> dict[str, ComponentTopics]:
        """Return the components that write a topic, by name."""
        return {name: one for name, one in sorted(self.components.items()) if topic in one.outputs}

    def next(self, topic: str, *, forward: bool) -> list[tuple[str, str]]:
        """Return the components that read (or, backwards, write) a topic, with each topic beyond them, sorted."""
        found = []
        for name, component in self.components.items():
            here, there = component.inputs, component.outputs
            if not forward:
                here, there = there, here
            if topic in here:
                found += [(name, other) for other in there]
        return sorted(found)

    def _closure(self, topic: str, *, forward: bool) -> frozenset[str]:
        seen = {topic}
        ahead = [topic]
        while ahead:
            for _, other in self.next(ahead.pop(), forward=forward):
                if other not in seen:
                    seen.add(other)
                    ahead.append(other)
        return frozenset(seen)

    def backtrack_tree(self, root: str, externals: Collection[str], *, most: int = 10_000) -> Hop:
        """Return the tree of all paths from an internal topic back to the externals, its first `most` hops.

        Branches that reach no external topic are left out, and paths end at the first external topic.
        """
        useful = frozenset[str]().union(*map(self.reached, externals))
        neighbours: dict[str, list[tuple[str, str]]] = {}
        used = 0

        def grow(topic: str, component: str | None, path: frozenset[str]) -> Hop:
            nonlocal used
            used += 1
            external = topic in externals
            if topic in path:
                return Hop(topic, component, external, loop=True)
            if external and path:
                return Hop(topic, component, external)
            if used >= most:
                return Hop(topic, component, external, cut=True)
            if topic not in neighbours:
                neighbours[topic] = [one for one in self.next(topic, forward=False) if one[1] in useful]
            hops: list[Hop] = []
            for name, other in neighbours[topic]:
                if used >= most:
                    return Hop(topic, component, external, cut=True, hops=tuple(hops))
                hops.append(grow(other, name, path | {topic}))
            return Hop(topic, component, external, hops=tuple(hops))

        return grow(root, None, frozenset())
