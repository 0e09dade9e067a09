"""The graph of a bus: components, topics, who publishes and who subscribes, and what is not known."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from riot_bus.types.capabilities import Role

Part = Literal["component", "topic", "edge", "unknown"]

CALL_ROLES: tuple[Role, ...] = ("serves", "calls")
"""Roles of components for services and actions; all other roles are for topics."""


@dataclass(frozen=True, slots=True)
class ConnectedComponent:
    """A session that is connected to a segment, or a link of a bridge in the router's own process.

    Attributes:
        segment: Name of the segment; empty if it is behind another router or peer.
        zid: Id of its Zenoh session; for a link, its segment and name.
        mode: `client`, `peer`, `router` or `link`; empty if unknown.
        name: `metadata.name` of its configuration, known only if its admin space is enabled; for a link, its name.
        nodes: Its ROS nodes; for a link, the systems that were heard there.
        addresses: Its ends of the links to the segment.
        pid: Process id, if it runs on this host and we may see it.
    """

    segment: str
    zid: str
    mode: str = ""
    name: str = ""
    nodes: tuple[str, ...] = ()
    addresses: tuple[str, ...] = ()
    pid: int | None = None
    command: str = ""

    @property
    def label(self) -> str:
        """What people call it: its name, ROS nodes, command, or the start of its id."""
        return self.name or ", ".join(self.nodes) or self.command or self.zid[:8]


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic, service or subscribed key expression.

    Attributes:
        type_name: Message type, if an announcement states it.
        intercepted: Whether its messages, or its requests and replies, go through the pipeline.
        action: Name of the action that it belongs to.
        action_type: Type of that action, if its announcement states it.
    """

    key: str
    name: str
    type_name: str = ""
    intercepted: bool = False
    action: str = ""
    action_type: str = ""


@dataclass(frozen=True, slots=True)
class Edge:
    """A component publishes on, subscribes to, serves or calls a topic.

    Attributes:
        segment: Name of the segment; empty if not known.
        zid: Id of the component; empty if not known.
        node: Its ROS node, if announced, or the system behind the link.
        evidence: Sources of this knowledge, sorted: `ros2 token`, `bridge token`, `advanced token`, `traffic`,
            `timestamp` (the sender stamped its messages), `matching` (there is a receiver), `declaration`, `bridge`
            (it says so itself), and `only component` (of that segment: a conclusion).
        messages: Number of messages so far, if they could be attributed; not compared.
        rate: Recent messages per second; not compared.
    """

    topic: str
    role: Role
    segment: str = ""
    zid: str = ""
    node: str = ""
    evidence: tuple[str, ...] = ()
    messages: int = field(default=0, compare=False)
    rate: float = field(default=0.0, compare=False)

    @property
    def identity(self) -> tuple[str, str, str, str, str]:
        """Values that identify the edge."""
        return (self.topic, self.role, self.segment, self.zid, self.node)


@dataclass(frozen=True, slots=True, order=True)
class Unknown:
    """Something that the graph does not show.

    Attributes:
        about: A topic's key, a component's id, or empty.
        segment: Name of the segment; empty if it holds for the whole bus.
    """

    about: str
    segment: str
    text: str


@dataclass(frozen=True, slots=True, order=True)
class GraphChange:
    """One difference between two graphs."""

    what: Part
    kind: Literal["appeared", "vanished", "changed"]
    subject: str


@dataclass(frozen=True, slots=True)
class Graph:
    """Components, topics and the edges between them; sorted, so that equal networks give equal graphs.

    Counts and rates are not compared.
    """

    components: tuple[ConnectedComponent, ...] = ()
    topics: tuple[Topic, ...] = ()
    edges: tuple[Edge, ...] = ()
    unknown: tuple[Unknown, ...] = ()

    @classmethod
    def of(
        cls,
        components: Iterable[ConnectedComponent],
        topics: Iterable[Topic],
        edges: Iterable[Edge],
        unknown: Iterable[Unknown],
    ) -> Graph:
        """Return a graph with its parts sorted."""
        return cls(
            components=tuple(sorted(components, key=lambda each: (each.segment, each.zid))),
            topics=tuple(sorted(topics, key=lambda each: each.key)),
            edges=tuple(sorted(edges, key=lambda each: each.identity)),
            unknown=tuple(sorted(set(unknown))),
        )

    def component(self, zid: str, segment: str | None = None) -> ConnectedComponent | None:
        """Return a component by its id, in any segment unless one is named; None if there is none."""
        found = (each for each in self.components if each.zid == zid and segment in (None, each.segment))
        return next(found, None)

    def changes_since(self, other: Graph) -> tuple[GraphChange, ...]:
        """Return the differences from an earlier graph, sorted; message counts and rates are ignored."""
        changes = []
        for what, before, after in zip(_SUBJECTS, other._by_subject(), self._by_subject(), strict=True):
            changes += [GraphChange(what, "appeared", subject) for subject in after.keys() - before.keys()]
            changes += [GraphChange(what, "vanished", subject) for subject in before.keys() - after.keys()]
            both = before.keys() & after.keys()
            changes += [GraphChange(what, "changed", one) for one in both if before[one] != after[one]]
        return tuple(sorted(changes))

    def _by_subject(self) -> Iterator[dict[str, object]]:
        """Yield the parts of each kind in the order of `_SUBJECTS`, by what changes call them."""
        for parts, subject in zip(
            (self.components, self.topics, self.edges, self.unknown), _SUBJECTS.values(), strict=True
        ):
            yield {subject(each): each for each in parts}


def _edge_subject(edge: Edge) -> str:
    node = f" ({edge.node})" if edge.node else ""
    where = edge.segment or "an unknown segment"
    return f"{edge.zid or 'an unknown component'}{node} in {where} {edge.role} {edge.topic}"


_SUBJECTS: dict[Part, Callable[[Any], str]] = {
    "component": lambda component: f"{component.zid} in {component.segment or 'no segment'}",
    "topic": lambda topic: str(topic.key),
    "edge": _edge_subject,
    "unknown": lambda unknown: ": ".join(filter(None, (unknown.about, unknown.segment, unknown.text))),
}
"""What a change calls the changed part, for each kind of part."""
