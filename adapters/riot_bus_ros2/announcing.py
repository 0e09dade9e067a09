"""Participants of a ROS 2 system, from the liveliness tokens of rmw_zenoh and zenoh-bridge-ros2dds, without I/O."""

from __future__ import annotations

from dataclasses import replace

from riot_bus.types.capabilities import Announcement, Role
from riot_bus_ros2 import ros2dds
from riot_bus_ros2.keys import action_of, action_type
from riot_bus_ros2.tokens import Node, parse_token

EXPRESSIONS = ("**/@ros2_lv/**", ros2dds.TOKENS)
"""Key expressions of all tokens, also of sessions with a Zenoh namespace; no `**` matches what begins with `@`."""

_ROLES: dict[str, Role] = {
    "MP": "publishes",
    "MS": "subscribes",
    "SS": "serves",
    "SC": "calls",
    "AS": "serves",
    "AC": "calls",
}
_ACTIONS = ("AS", "AC")


def announcement_of(token: str, *, namespace: str = "/") -> Announcement | None:
    """Return what a token announces, None if it is not a token of ROS 2.

    Example:
        >>> announcement_of("@/3f/@ros2_lv/AS/dock/nav_msgs§action§Dock").action
        '/dock'
    """
    bridge = ros2dds.parse_bridge_token(token)
    if bridge is not None:
        return _with_action(
            Announcement(
                zid=bridge.zid,
                role=_ROLES[bridge.kind],
                key=bridge.key,
                node="",
                topic=ros2dds.name_of(bridge.key, namespace),
                type_name=bridge.type_name,
                source="bridge token",
            ),
            itself=bridge.kind in _ACTIONS,
        )
    found = parse_token(token)
    if found is None:
        return None
    if isinstance(found, Node):
        return Announcement(found.zid, None, "", found.name, "", "", "ros2 token")
    role, node = _ROLES[found.kind], found.node
    return _with_action(Announcement(node.zid, role, found.key, node.name, found.topic, found.type_name, "ros2 token"))


def _with_action(found: Announcement, *, itself: bool = False) -> Announcement:
    if itself:
        return replace(found, action=found.topic, action_type=found.type_name)
    part = action_of(found.topic)
    if part is None:
        return found
    return replace(found, action=part[0], action_type=action_type(part[1], found.type_name) or "")
