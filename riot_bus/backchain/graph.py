"""Topic graphs, and the backtrack trees of external topics that can reach an internal one (RIOT II-C, after Hiller)."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from riot_bus.backchain.extras import strong_components

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

_DEEPEST = 200
"""Most hops on one path of a tree that follows each topic once; real systems have a tenth of that."""


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
        external: Whether the outside world controls it.
        loop: Whether it is already on the path from the root; it is not followed again.
        cut: Whether it is not followed because the tree was too large.
        again: Whether its next hops are elsewhere in the tree.
        hops: The next hops, by component and topic.
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

    def loops(self) -> list[tuple[str, ...]]:
        """Return the sets of topics that lead back to themselves, each sorted."""
        topics = sorted({topic for one in self.components.values() for topic in (*one.inputs, *one.outputs)})
        number = {topic: place for place, topic in enumerate(topics)}
        arrows = [
            (number[source], number[target])
            for one in self.components.values()
            for source in one.inputs
            for target in one.outputs
        ]
        groups: dict[int, list[str]] = {}
        for topic, label in zip(topics, strong_components(len(topics), arrows), strict=True):
            groups.setdefault(label, []).append(topic)
        alone = {source for source, target in arrows if source == target}
        return [tuple(one) for one in groups.values() if len(one) > 1 or number[one[0]] in alone]

    def backtrack_tree(self, topic: str, externals: Collection[str], *, most: int = 10_000, once: bool = False) -> Hop:
        """Return the tree of all paths from an internal topic back to the externals.

        Branches that reach no external topic are left out, and paths end at the first external topic.

        Args:
            most: Largest number of hops; what lies beyond is marked `cut`.
            once: Whether each topic is followed only once, at its place nearest to the root, and marked `again`
                elsewhere.
        """
        useful = frozenset[str]().union(*map(self.reached, externals))
        if once:
            return self._tree_once(topic, frozenset(externals), useful)
        return self._tree(topic, frozenset(externals), useful, most=most)

    def _next(self, topic: str, *, forward: bool) -> list[tuple[str, str]]:
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
            for _, other in self._next(ahead.pop(), forward=forward):
                if other not in seen:
                    seen.add(other)
                    ahead.append(other)
        return frozenset(seen)

    def _tree_once(self, root: str, externals: frozenset[str], useful: frozenset[str]) -> Hop:
        following: dict[str, list[tuple[str, str]]] = {}
        owner: dict[str, tuple[str, str] | None] = {root: None}
        ahead = [root]
        for topic in ahead:  # grows: topics by their distance from the root
            following[topic] = []
            if topic not in externals or topic == root:
                following[topic] = [one for one in self._next(topic, forward=False) if one[1] in useful]
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

    def _tree(self, root: str, externals: frozenset[str], useful: frozenset[str], *, most: int) -> Hop:
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
                neighbours[topic] = [one for one in self._next(topic, forward=False) if one[1] in useful]
            hops: list[Hop] = []
            for name, other in neighbours[topic]:
                if used >= most:
                    return Hop(topic, component, external, cut=True, hops=tuple(hops))
                hops.append(grow(other, name, path | {topic}))
            return Hop(topic, component, external, hops=tuple(hops))

        return grow(root, None, frozenset())
