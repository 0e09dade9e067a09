"""Services and actions of ROS 2: their keys, and the types of requests and replies.

Clients of rmw_zenoh ask with Zenoh's target `ALL_COMPLETE`, and its servers are complete queryables. Source:
rmw_client_data.cpp and rmw_service_data.cpp of ros2/rmw_zenoh.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.types.serve import REPLY, REQUEST
from riot_bus_ros2.keys import is_topic_expression, key_expression

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["SPACES", "action_parts", "call_type"]

SPACES: Sequence[str] = tuple(text for text in [key_expression("/**")] if text is not None)
"""Key expression of all services of rmw_zenoh."""

_TYPES = {REQUEST: "_Request", REPLY: "_Response"}


def action_parts(name: str) -> str | None:
    """Return a key expression of the topics and services of an action, None if the text is not a ROS name.

    Example:
        >>> action_parts("/fibonacci")
        '/fibonacci/_action/*'
    """
    return f"{name}/_action/*" if is_topic_expression(name) else None


def call_type(type_name: str, part: str) -> str | None:
    """Return the message type of a part of a service's calls; errors have none.

    Example:
        >>> call_type("example_interfaces/srv/AddTwoInts", "@reply")
        'example_interfaces/srv/AddTwoInts_Response'
    """
    return f"{type_name}{_TYPES[part]}" if part in _TYPES and type_name.count("/") == 2 else None
