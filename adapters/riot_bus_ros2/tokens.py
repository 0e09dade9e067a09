"""Liveliness tokens of rmw_zenoh, which announce ROS nodes and their topics and services.

    @ros2_lv/<domain>/<zid>/<node id>/<node id>/NN/<enclave>/<namespace>/<node>
    @ros2_lv/<domain>/<zid>/<node id>/<id>/<MP|MS|SS|SC>/<enclave>/<namespace>/<node>/<name>/<type>/<hash>/<qos>

Buffer-aware endpoints (2026) append a chunk about their memory.

Slashes in names are written as `%`, so that an empty namespace is `%`. Zenoh sessions with a `namespace` put that in
front. Source: docs/design.md and liveliness_utils.cpp of ros2/rmw_zenoh.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal, get_args

from riot_bus_ros2.keys import NO_HASH, DataKey, build_data_key, dds_type, parse_data_key, ros_type
from riot_bus_ros2.qos import RosQos

TOKENS = "@ros2_lv/**"
"""Key expression of all tokens of a network without a Zenoh namespace."""

EndpointKind = Literal["MP", "MS", "SS", "SC"]
"""Publisher, subscriber, service server, service client."""

_SPACE = "@ros2_lv"
_NODE_CHUNKS = 8  # those behind `_SPACE` in a node's token, as at the top
_ENDPOINT_CHUNKS = _NODE_CHUNKS + 4  # and name, type, hash and QoS
_MOST_PROFILES = 64  # a guess: tokens can be forged, and each would make the log's metadata longer
_KINDS: dict[str, EndpointKind] = {kind: kind for kind in get_args(EndpointKind)}
_NUMBER = re.compile(r"0|[1-9][0-9]{0,8}", re.ASCII)
_ZID = re.compile(r"[0-9a-f]{1,32}", re.ASCII)


@dataclass(frozen=True, slots=True)
class Node:
    """A ROS node.

    Attributes:
        number: Number of the node in the session.
        name: Full name, such as `/robot1/planner`.
        prefix: The session's Zenoh namespace.
    """

    domain: int
    zid: str
    number: int
    name: str
    enclave: str = "/"
    prefix: str = ""


@dataclass(frozen=True, slots=True)
class NodeEndpoint:
    """A publisher, subscriber, service server or service client of a node.

    Attributes:
        number: Number of the endpoint in its session.
        type_hash: Hash of its type, None if the distribution has no hashes.
        backend: Memory description of a buffer-aware endpoint; empty for all others.
    """

    node: Node
    number: int
    kind: EndpointKind
    topic: str
    type_name: str
    type_hash: str | None = None
    qos: RosQos = field(default_factory=RosQos)
    backend: str = ""

    @property
    def data_key(self) -> DataKey:
        """Data key of its messages."""
        return DataKey(self.node.domain, self.topic, self.type_name, self.type_hash)

    @property
    def key(self) -> str:
        """Zenoh key of its messages."""
        key = build_data_key(self.data_key)
        return f"{self.node.prefix}/{key}" if self.node.prefix else key


def parse_token(token: str) -> Node | NodeEndpoint | None:
    """Return the announced node or endpoint, None if this is not a token of rmw_zenoh.

    Example:
        >>> parse_token("@ros2_lv/0/3f2a/0/0/NN/%/%/talker").name
        '/talker'
    """
    prefix, found, rest = f"/{token}".partition(f"/{_SPACE}/")
    chunks = rest.split("/")
    if not found or len(chunks) < _NODE_CHUNKS or "" in chunks:
        return None
    domain, zid, node_number, number, kind, enclave, namespace, name = chunks[:_NODE_CHUNKS]
    if _ZID.fullmatch(zid) is None or any(_NUMBER.fullmatch(each) is None for each in (domain, node_number, number)):
        return None
    full = f"{_slashed(namespace).rstrip('/')}/{name}"
    node = Node(
        int(domain),
        zid,
        int(node_number),
        full if full.startswith("/") else f"/{full}",
        _slashed(enclave),
        prefix.strip("/"),
    )
    if kind == "NN":
        return node if len(chunks) == _NODE_CHUNKS else None
    if kind not in _KINDS or len(chunks) < _ENDPOINT_CHUNKS:
        return None
    topic, dds, type_hash, qos, *backend = chunks[_NODE_CHUNKS:]
    return NodeEndpoint(
        node,
        int(number),
        _KINDS[kind],
        _slashed(topic),
        ros_type(dds) or dds,
        None if type_hash == NO_HASH else type_hash,
        RosQos.parse(qos),
        "/".join(backend),
    )


def build_token(of: Node | NodeEndpoint) -> str:
    """Return the token that `parse_token` reads, as rmw_zenoh writes it: the gid is its hash."""
    node = of if isinstance(of, Node) else of.node
    namespace, _, name = node.name.rpartition("/")
    kind = "NN" if isinstance(of, Node) else of.kind
    chunks = [_SPACE, str(node.domain), node.zid, str(node.number), str(of.number), kind]
    chunks += [_mangled(node.enclave or "/"), _mangled(namespace or "/"), name]
    if isinstance(of, NodeEndpoint):
        chunks += [_mangled(of.topic), dds_type(of.type_name), of.type_hash or NO_HASH, of.qos.token()]
        chunks += [of.backend] if of.backend else []
    return "/".join([node.prefix, *chunks] if node.prefix else chunks)


def details_of(key: str, tokens: Iterable[str]) -> dict[str, str]:
    """Return the offered QoS of all publishers of a key, as rosbag2 writes it; empty if there is none."""
    wanted = parse_data_key(key)
    if wanted is None:
        return {}
    name = f"/{_mangled(wanted.topic)}/"
    found = (parse_token(each) for each in sorted(tokens) if name in each and "/MP/" in each)
    return profiles_of(
        each.qos
        for each in found
        if isinstance(each, NodeEndpoint)
        and each.kind == "MP"
        and (each.node.domain, each.topic, each.type_name) == (wanted.domain, wanted.topic, wanted.type_name)
    )


def profiles_of(offered: Iterable[RosQos]) -> dict[str, str]:
    """Return a channel's metadata with the QoS that publishers offer; empty if there are none."""
    profiles = [each.profile() for each in offered][:_MOST_PROFILES]
    return {"offered_qos_profiles": "".join(profiles)} if profiles else {}


def _mangled(name: str) -> str:
    return name.replace("/", "%")


def _slashed(chunk: str) -> str:
    return chunk.replace("%", "/")
