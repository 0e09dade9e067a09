"""Which external topics can reach an internal one: backtrack and trace trees (RIOT II-C, after Hiller et al.)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

__all__ = ["ComponentTopics", "Hop", "TopicGraph"]


@dataclass(frozen=True, slots=True)
class ComponentTopics:
    """The topics that one component reads and writes."""

    inputs: frozenset[str] = frozenset()
    outputs: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Hop:
    """A topic in a tree, and the topics one component further on.

    Attributes:
        topic: The topic.
        component: Component that connects it to its parent in the tree; None at the root.
        external: Whether the outside world controls it.
        loop: Whether it is already on the path from the root; it is not followed again.
        cut: Whether the tree was too large to follow it.
        hops: What comes next, by component and topic.
    """

    topic: str
    component: str | None = None
    external: bool = False
    loop: bool = False
    cut: bool = False
    hops: tuple[Hop, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the tree as nested dicts and lists."""
        return {
            "topic": self.topic,
            "component": self.component,
            "external": self.external,
            "loop": self.loop,
            "cut": self.cut,
            "hops": [hop.as_json() for hop in self.hops],
        }

    def text(self) -> str:
        """Return the tree as indented lines."""
        return "\n".join(self._lines(0))

    def _lines(self, depth: int) -> list[str]:
        marks = [word for word in ("external", "loop", "cut") if getattr(self, word)]
        via = f" via {self.component}" if self.component is not None else ""
        line = "  " * depth + self.topic + via + (f" [{', '.join(marks)}]" if marks else "")
        return [line] + [text for hop in self.hops for text in hop._lines(depth + 1)]


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

    def backtrack_tree(self, topic: str, externals: Collection[str], *, most: int = 10_000) -> Hop:
        """Return the tree of all paths from an internal topic back to the externals.

        Branches that reach no external topic are left out, and paths end at the first external topic.

        Args:
            topic: The internal topic.
            externals: Topics that the outside world controls.
            most: Largest number of hops; what lies beyond is marked `cut`.
        """
        useful = frozenset().union(*(self.reached(one) for one in externals)) if externals else frozenset()
        return self._tree(topic, frozenset(externals), useful, most=most, forward=False)

    def trace_tree(self, topic: str, targets: Collection[str], *, most: int = 10_000) -> Hop:
        """Return the tree of all paths from an external topic to the targets (see `backtrack_tree`).

        `external` marks the external topic alone.
        """
        useful = frozenset().union(*(self.reaching(one) for one in targets)) if targets else frozenset()
        return self._tree(topic, frozenset({topic}), useful, most=most, forward=True)

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

    def _tree(self, root: str, externals: frozenset[str], useful: frozenset[str], *, most: int, forward: bool) -> Hop:
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
                neighbours[topic] = [one for one in self._next(topic, forward=forward) if one[1] in useful]
            hops: list[Hop] = []
            for name, other in neighbours[topic]:
                if used >= most:
                    return Hop(topic, component, external, cut=True, hops=tuple(hops))
                hops.append(grow(other, name, path | {topic}))
            return Hop(topic, component, external, hops=tuple(hops))

        return grow(root, None, frozenset())
