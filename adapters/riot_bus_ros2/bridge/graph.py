"""The graph of a ROS domain, as the bridge's node reports it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from riot_bus_ros2.qos import FOREVER, AnnouncedQos

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["DomainEndpoint", "DomainGraph", "Profile", "announced", "profile_of"]

_SECOND = 10**9  # nanoseconds, as in `Profile`
RELIABLE, BEST_EFFORT = 1, 2
LATCHED, VOLATILE = 1, 2
KEEP_LAST, KEEP_ALL = 1, 2
AUTOMATIC, BY_TOPIC = 1, 3  # rmw's numbers, as above; 2 (by node) is deprecated


class Profile(NamedTuple):
    """Quality of service in rmw's numbers; durations in nanoseconds, 0 if infinite.

    Attributes:
        reliability: 1 reliable, 2 best effort.
        durability: 1 transient local, 2 volatile.
        history: 1 keep last, 2 keep all; DDS does not tell it.
        depth: Depth of the history, 0 if DDS does not tell it.
        deadline: Longest time between two messages.
        lifespan: Age beyond which messages are not delivered.
        liveliness: 1 automatic, 3 by topic.
        lease: Longest silence after which a publisher still counts as alive.
    """

    reliability: int = RELIABLE
    durability: int = VOLATILE
    history: int = KEEP_LAST
    depth: int = 0
    deadline: int = 0
    lifespan: int = 0
    liveliness: int = AUTOMATIC
    lease: int = 0


class DomainEndpoint(NamedTuple):
    """A publisher, subscription, server or client of the domain; servers and clients have no profile and no gid.

    Attributes:
        node: Full name of its node, empty if it does not belong to a ROS node.
        topic: Full name of the topic or service.
        type_name: Name of its type, such as `nav_msgs/msg/Odometry`.
        type_hash: Hash of its type, None if the distribution has no hashes.
        profile: Its quality of service.
        gid: Its id in DDS, in hexadecimal.
    """

    node: str
    topic: str
    type_name: str
    type_hash: str | None
    profile: Profile = Profile()
    gid: str = ""


@dataclass(frozen=True, slots=True)
class DomainGraph:
    """Nodes and endpoints of a domain, without the endpoints of bridges.

    Attributes:
        bridges: Names of the nodes of bridges.
        nodes: Names of all other nodes.
        publishers: Publishers of topics.
        subscriptions: Subscriptions to topics.
        servers: Servers of services.
        clients: Clients of services.
        matched: Number of subscriptions that match a publisher of ours, by the publisher's number.
        ready: Numbers of our clients whose server would get a request.
    """

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
                DomainEndpoint(node, topic, type_name, type_hash or None, *_details(more))
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


def announced(profile: Profile, *, depth: int) -> AnnouncedQos:
    """Return a profile as rmw_zenoh announces it.

    Args:
        profile: Profile as reported by DDS.
        depth: Depth to use if DDS does not tell it.
    """
    return AnnouncedQos(
        RELIABLE if profile.reliability == RELIABLE else BEST_EFFORT,
        LATCHED if profile.durability == LATCHED else VOLATILE,
        KEEP_ALL if profile.history == KEEP_ALL else KEEP_LAST,
        profile.depth or depth,
        _pair(profile.deadline),
        _pair(profile.lifespan),
        BY_TOPIC if profile.liveliness == BY_TOPIC else AUTOMATIC,
        _pair(profile.lease),
    )


def profile_of(qos: AnnouncedQos) -> Profile:
    """Return the profile of an announced QoS, the inverse of `announced`."""
    return Profile(
        qos.reliability,
        qos.durability,
        qos.history,
        qos.depth,
        _nanoseconds(qos.deadline),
        _nanoseconds(qos.lifespan),
        qos.liveliness,
        _nanoseconds(qos.lease),
    )


def _details(more: Sequence[Any]) -> tuple[Profile, str] | tuple[()]:
    return (Profile(*more[0]), more[1]) if more else ()


def _pair(nanoseconds: int) -> tuple[int, int]:
    seconds, rest = divmod(nanoseconds, _SECOND)
    return (seconds, rest) if nanoseconds else FOREVER


def _nanoseconds(pair: tuple[int, int]) -> int:
    return 0 if pair >= FOREVER else pair[0] * _SECOND + pair[1]
