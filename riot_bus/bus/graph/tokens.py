"""What components announce by liveliness tokens: nodes, publishers, subscribers, services, and their sessions' ids.

Formats: rmw_zenoh's `docs/design.md`, zenoh-plugin-ros2dds, and zenoh-ext's advanced publishers and subscribers.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from riot_bus.bus.graph.model import Role

__all__ = ["EXPRESSIONS", "Token", "parse_token"]

EXPRESSIONS = ("**/@ros2_lv/**", "@/*/@ros2_lv/**", "**/@adv/**")
"""Where tokens live. `@...` chunks are verbatim: no `**` matches them."""

_ROS_ROLES: dict[str, Role] = {"MP": "publishes", "MS": "subscribes", "SS": "serves", "SC": "calls"}
_BRIDGE_ROLES: dict[str, Role] = {**_ROS_ROLES, "AS": "serves", "AC": "calls"}
_ADVANCED_ROLES: dict[str, Role] = {"pub": "publishes", "sub": "subscribes"}
_ADVANCED = re.compile(r"(?P<key>.+)/@adv/(?P<role>pub|sub)/(?P<zid>[0-9a-f]+)/[^/]+(?:/.*)?")
_BRIDGE = re.compile(r"@/(?P<zid>[0-9a-f]+)/@ros2_lv/(?P<role>[A-Z]{2})/(?P<key>[^/]+)/(?P<type>[^/]+)(?:/.*)?")
_DDS_TYPE = re.compile(r"(?P<package>\w+)::(?P<kind>msg|srv|action)::dds_::(?P<name>\w+)_")
_ENTITY_CHUNKS = 11
_NODE_CHUNKS = 8


@dataclass(frozen=True, slots=True)
class Token:
    """One announcement.

    Attributes:
        zid: Id of the session that made it.
        role: What it announces; None for a ROS node.
        key: Key or key expression; empty for a node.
        node: Full name of the ROS node.
        topic: ROS name of the topic or service.
        type_name: Its type.
        source: `ros2 token`, `bridge token` or `advanced token`.
    """

    zid: str
    role: Role | None
    key: str
    node: str
    topic: str
    type_name: str
    source: str


def parse_token(key: str) -> Token | None:
    """Return what a liveliness token announces, None if it is nothing that we know.

    Args:
        key: The token's key.

    Example:
        >>> parse_token("0/a/@adv/pub/3f2a/uhlc/_").role
        'publishes'
    """
    bridge = _BRIDGE.fullmatch(key)
    if bridge is not None:
        role = _BRIDGE_ROLES.get(bridge["role"])
        name, type_name = bridge["key"].replace("§", "/"), bridge["type"].replace("§", "/")
        return role and Token(bridge["zid"], role, name, "", f"/{name}", type_name, "bridge token")
    advanced = _ADVANCED.fullmatch(key)
    if advanced is not None:
        role = _ADVANCED_ROLES[advanced["role"]]
        return Token(advanced["zid"], role, advanced["key"], "", "", "", "advanced token")
    prefix, found, rest = f"/{key}".partition("/@ros2_lv/")
    return _ros(prefix.strip("/"), rest.split("/")) if found else None


def _ros(prefix: str, chunks: list[str]) -> Token | None:
    """Read `<domain>/<zid>/<node id>/<entity id>/<kind>/<enclave>/<namespace>/<node>[/<name>/<type>/<hash>/<qos>]`."""
    if len(chunks) < _NODE_CHUNKS:
        return None
    domain, zid, _, _, kind, _, namespace, name = chunks[:_NODE_CHUNKS]
    node = f"{_unmangle(namespace).rstrip('/')}/{name}"
    if not node.startswith("/"):
        node = f"/{node}"
    if kind == "NN":
        return Token(zid, None, "", node, "", "", "ros2 token")
    role = _ROS_ROLES.get(kind)
    if role is None or len(chunks) < _ENTITY_CHUNKS:
        return None
    topic, dds_type, type_hash = chunks[_NODE_CHUNKS:_ENTITY_CHUNKS]
    full = _unmangle(topic)
    parts = [prefix, domain, full.strip("/"), dds_type, type_hash]
    match = _DDS_TYPE.fullmatch(dds_type)
    type_name = f"{match['package']}/{match['kind']}/{match['name']}" if match else dds_type
    return Token(zid, role, "/".join(filter(None, parts)), node, full, type_name, "ros2 token")


def _unmangle(text: str) -> str:
    return text.replace("%", "/")
