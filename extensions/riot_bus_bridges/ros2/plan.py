"""Plan of a bridge, as a function of the endpoints in the domain and on the segment."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from riot_bus_ros2.keys import DataKey
from riot_bus_ros2.qos import FOREVER, USUAL_DEPTH, Durability, HistoryPolicy, Liveliness, Reliability, RosQos

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from riot_bus_bridges.ros2.options import Names, Ros2BridgeOptions
    from riot_bus_ros2.qos import Duration
    from riot_bus_ros2.tokens import EndpointKind, NodeEndpoint


class DomainEndpoint(NamedTuple):
    """A publisher, subscription, server or client of the domain; servers and clients have no QoS and no gid.

    Attributes:
        type_hash: Hash of its type, None if the distribution has no hashes.
        gid: Its id in DDS, in hexadecimal.
    """

    node: str
    topic: str
    type_name: str
    type_hash: str | None
    qos: RosQos = RosQos(depth=0)
    gid: str = ""


@dataclass(frozen=True, slots=True)
class DomainGraph:
    """Nodes and endpoints of a domain, without the endpoints of bridges."""

    bridges: Sequence[str] = ()
    nodes: Sequence[str] = ()
    publishers: Sequence[DomainEndpoint] = ()
    subscriptions: Sequence[DomainEndpoint] = ()
    servers: Sequence[DomainEndpoint] = ()
    clients: Sequence[DomainEndpoint] = ()
    matched: Mapping[int, int] = field(default_factory=dict)
    ready: Sequence[int] = ()

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Self:
        """Read the node's report."""

        def endpoints(name: str) -> list[DomainEndpoint]:
            return [
                DomainEndpoint(node, topic, type_name, type_hash or None, RosQos.of_numbers(more[0]), more[1])
                if more
                else DomainEndpoint(node, topic, type_name, type_hash or None)
                for node, topic, type_name, type_hash, *more in document[name]
            ]

        return cls(
            document["bridges"],
            document["nodes"],
            endpoints("publishers"),
            endpoints("subscriptions"),
            endpoints("servers"),
            endpoints("clients"),
            {int(number): count for number, count in document["matched"].items()},
            document["ready"],
        )


_NAMELESS = "/dds"  # stands for DDS participants that are not ROS nodes


class UpPlan(NamedTuple):
    """Plan for a topic that goes from the domain to the segment."""

    reader: RosQos
    reliable: bool
    latched: bool

    @property
    def sourced(self) -> bool:
        """Whether there are publishers; without them, there is no such plan."""
        return True

    def means(self, other: object) -> bool:
        """Return whether the same is to be done as with another plan."""
        return self == other


class DownPlan(NamedTuple):
    """Plan for a topic that goes from the segment to the domain.

    Attributes:
        latched: Number of kept messages to fetch from publishers on the segment; None if they keep none.
        sourced: Whether there are publishers on the segment, as far as they are announced.
    """

    writer: RosQos
    latched: int | None
    sourced: bool

    def means(self, other: object) -> bool:
        """Return whether the same is to be done as with another plan."""
        return isinstance(other, DownPlan) and self[:2] == other[:2]


class DomainAnnouncement(NamedTuple):
    """Node or endpoint of the domain that is announced on the segment by a token.

    Attributes:
        gid: Id that distinguishes otherwise identical endpoints.
    """

    kind: EndpointKind | None
    node: str
    key: DataKey | None = None
    qos: RosQos = RosQos()
    gid: str = ""


@dataclass(frozen=True, slots=True)
class BridgePlan:
    """Everything that a bridge should carry and announce.

    Attributes:
        downs: Topics that have publishers on the segment or subscriptions in the domain.
        foreign: Topics and services whose types or type hashes differ between domain and segment.
    """

    ups: dict[DataKey, UpPlan] = field(default_factory=dict)
    downs: dict[DataKey, DownPlan] = field(default_factory=dict)
    offered: set[DataKey] = field(default_factory=set)
    wanted: set[DataKey] = field(default_factory=set)
    announcements: set[DomainAnnouncement] = field(default_factory=set)
    foreign: set[str] = field(default_factory=set)


def plan_of(
    graph: DomainGraph,
    segment: Iterable[NodeEndpoint],
    names: Names,
    options: Ros2BridgeOptions,
    *,
    bridges: Collection[str] = (),
) -> BridgePlan:
    """Return the plan of a bridge.

    Args:
        bridges: Zenoh session ids of other bridges, each of which has one publisher for all that it announces.
    """

    def key_of(found: DomainEndpoint) -> DataKey:
        return DataKey(options.zenoh_domain, found.topic, found.type_name, found.type_hash)

    def grouped(endpoints: Sequence[DomainEndpoint]) -> dict[DataKey, list[RosQos]]:
        groups: dict[DataKey, list[RosQos]] = defaultdict(list)
        for each in endpoints:
            if names.topic(each.topic):
                groups[key_of(each)].append(each.qos)
        return groups

    published, subscribed = grouped(graph.publishers), grouped(graph.subscriptions)
    elsewhere: dict[DataKey, list[RosQos]] = defaultdict(list)
    kept: dict[DataKey, dict[object, int]] = defaultdict(dict)
    served: set[DataKey] = set()
    for endpoint in segment:
        if endpoint.kind == "MP" and names.topic(endpoint.topic):
            elsewhere[endpoint.data_key].append(endpoint.qos)
            if endpoint.qos.latched:
                keeper = endpoint.node.zid if endpoint.node.zid in bridges else endpoint
                former = kept[endpoint.data_key].get(keeper, 0)
                kept[endpoint.data_key][keeper] = max(former, endpoint.qos.depth)
        elif endpoint.kind == "SS" and names.service(endpoint.topic):
            served.add(endpoint.data_key)
    offered = {key_of(each) for each in graph.servers if names.service(each.topic)}
    here = {key.topic for key in offered}
    return BridgePlan(
        {key: _up(profiles, options) for key, profiles in published.items()},
        {
            key: _down(elsewhere.get(key, ()), subscribed.get(key, ()), kept.get(key, {}).values(), options)
            for key in {*elsewhere, *subscribed}
        },
        offered,
        {key for key in served if key.topic not in here},
        _announcements(graph, names, key_of, options),
        _foreign(elsewhere, {*published, *subscribed}) | _foreign(served, {key_of(each) for each in graph.clients}),
    )


def _up(profiles: Sequence[RosQos], options: Ros2BridgeOptions) -> UpPlan:
    """Subscribe so that all publishers match, as `ros2 bag record` does."""
    reliable = all(each.reliable for each in profiles)
    latched = all(each.latched for each in profiles)
    depth = max(options.depth, options.latched) if latched else options.depth
    durability = Durability.LATCHED if latched else Durability.VOLATILE
    reliability = Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT
    return UpPlan(RosQos(reliability, durability, HistoryPolicy.KEEP_LAST, depth), reliable, latched)


def _down(
    elsewhere: Sequence[RosQos], subscribed: Sequence[RosQos], depths: Iterable[int], options: Ros2BridgeOptions
) -> DownPlan:
    """Publish like the publishers on the segment; if their QoS is unknown, so that all subscriptions match."""
    profiles = elsewhere or subscribed
    latched = any(each.latched for each in profiles)
    reliable = not elsewhere or any(each.reliable for each in elsewhere)
    kept = options.latched
    if latched and elsewhere:
        kept = min(1 << 16, sum(depths))  # peers may announce any depth
    by_topic = any(each.liveliness == Liveliness.BY_TOPIC for each in profiles)
    writer = RosQos(
        Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT,
        Durability.LATCHED if latched else Durability.VOLATILE,
        HistoryPolicy.KEEP_LAST,
        kept if latched else options.depth,
        _shortest(each.deadline for each in profiles),
        _longest(each.lifespan for each in elsewhere),
        Liveliness.BY_TOPIC if by_topic else Liveliness.AUTOMATIC,
        _shortest(each.lease for each in profiles),
    )
    return DownPlan(writer, kept if latched else None, bool(elsewhere))


def _announcements(
    graph: DomainGraph, names: Names, key_of: Callable[[DomainEndpoint], DataKey], options: Ros2BridgeOptions
) -> set[DomainAnnouncement]:
    found: set[DomainAnnouncement] = set()
    kinds: list[tuple[EndpointKind, Sequence[DomainEndpoint], Callable[[str], bool]]] = [
        ("MP", graph.publishers, names.topic),
        ("MS", graph.subscriptions, names.topic),
        ("SS", graph.servers, names.service),
        ("SC", graph.clients, names.service),
    ]
    for kind, endpoints, is_bridged in kinds:
        for each in endpoints:
            if is_bridged(each.topic):
                depth = options.latched if each.qos.latched and kind == "MP" else USUAL_DEPTH
                qos = replace(each.qos, depth=each.qos.depth or depth)  # DDS does not tell the depth
                found.add(DomainAnnouncement(kind, each.node or _NAMELESS, key_of(each), qos, each.gid))
    return found | {DomainAnnouncement(None, each.node) for each in found}


def _foreign(one: Collection[DataKey], other: Collection[DataKey]) -> set[str]:
    same = {key.topic for key in one if key in other}
    return {key.topic for key in one} & {key.topic for key in other} - same


def _shortest(durations: Iterable[Duration]) -> Duration:
    return min([FOREVER, *filter(any, durations)])  # zero stands for infinity


def _longest(durations: Iterable[Duration]) -> Duration:
    found = [each if any(each) else FOREVER for each in durations]
    return min(FOREVER, max(found, default=FOREVER))
