"""The graph of a ROS domain, as the bridge's node reports it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from riot_bus_ros2.qos import RosQos

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


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
