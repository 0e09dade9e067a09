"""Data keys of rmw_zenoh: `<domain>/<topic>/<dds type>/<type hash>`, and the topics and services of an action.

Source: docs/design.md of ros2/rmw_zenoh. The topic may have any number of chunks, so the key is parsed from the right.
Buffer-aware endpoints (2026) append `_buf_cpu` or `_buf/<subscriber gid>`; Humble writes `TypeHashNotSupported`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

NO_HASH = "TypeHashNotSupported"

_CHUNK = r"[^/\s#?$*@][^/\s#?$*]*"
_KEY = re.compile(
    r"(?P<domain>0|[1-9][0-9]{0,8})/"
    rf"(?P<topic>{_CHUNK}(?:/{_CHUNK})*)/"
    r"(?P<type>[A-Za-z]\w*::(?:msg|srv|action)::dds_::[A-Za-z]\w*_)/"
    rf"(?P<hash>RIHS[0-9]{{2}}_[0-9a-f]+|{NO_HASH})"
    r"(?:/(?P<suffix>_buf_cpu|_buf/[0-9a-f]+))?",
    re.ASCII,
)
_TYPE = re.compile(r"([A-Za-z]\w*)::(msg|srv|action)::dds_::([A-Za-z]\w*)_", re.ASCII)
_TOPIC = re.compile(r"/[^/\s#?:]+(?:/[^/\s#?:]+)*")
_NAME = re.compile(r"(?:/\w+)+", re.ASCII)
_ANY_TYPE = "$*::dds_::$*"
SERVICES = f"*/**/{_ANY_TYPE}/*/**"
"""Key expression of all services of rmw_zenoh."""
_EXPRESSION = re.compile(rf"\*(/.+)/{re.escape(_ANY_TYPE)}/\*/\*\*")


@dataclass(frozen=True, slots=True)
class DataKey:
    """A topic or service of one ROS domain; `type_hash` is None where the distribution has none.

    Attributes:
        topic: Full name, such as `/robot1/odom`.
        suffix: Suffix of buffer-aware endpoints: empty, `_buf_cpu` or `_buf/<gid>`.
    """

    domain: int
    topic: str
    type_name: str
    type_hash: str | None = None
    suffix: str = ""


def parse_data_key(key: str) -> DataKey | None:
    """Return the parts of a key, None if it is not one of rmw_zenoh.

    Example:
        >>> parse_data_key("0/robot1/odom/nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported").topic
        '/robot1/odom'
    """
    match = _KEY.fullmatch(key)
    if match is None:
        return None
    domain, topic, dds, type_hash, suffix = match.groups()
    return DataKey(
        domain=int(domain),
        topic=f"/{topic}",
        type_name=ros_type(dds) or dds,
        type_hash=None if type_hash == NO_HASH else type_hash,
        suffix=suffix or "",
    )


def build_data_key(key: DataKey) -> str:
    """Return the key that `parse_data_key` reads."""
    parts = [str(key.domain), key.topic.strip("/"), dds_type(key.type_name), key.type_hash or NO_HASH]
    return "/".join([*parts, key.suffix] if key.suffix else parts)


def ros_type(dds: str) -> str | None:
    """Return `std_msgs/msg/String` for `std_msgs::msg::dds_::String_`, None if it is not a type of ROS."""
    match = _TYPE.fullmatch(dds)
    return None if match is None else "/".join(match.groups())


def dds_type(name: str) -> str:
    """Return `std_msgs::msg::dds_::String_` for `std_msgs/msg/String`; names without slashes stay as they are."""
    if "/" not in name:
        return name
    package, kind, short = name.split("/")
    return f"{package}::{kind}::dds_::{short}_"


def key_expression(topic: str, *, domain: int | None = None) -> str | None:
    """Return the key expression of a ROS name, with any type, hash and suffix; None if the text is not such a name.

    The type takes exactly one chunk, which excludes longer names: `/odom` does not match `/odom/filtered`.

    Args:
        topic: Name that begins with `/`; Zenoh's wildcards are allowed.

    Example:
        >>> key_expression("/odom")
        '*/odom/$*::dds_::$*/*/**'
    """
    if not is_topic_expression(topic):
        return None
    return f"{'*' if domain is None else domain}{topic}/{_ANY_TYPE}/*/**"


def name_of_expression(expression: str) -> str | None:
    """Return the ROS name that `key_expression` was called with, in any domain; None for other expressions.

    Example:
        >>> name_of_expression("*/odom/$*::dds_::$*/*/**")
        '/odom'
    """
    match = _EXPRESSION.fullmatch(expression)
    return match[1] if match is not None and is_topic_expression(match[1]) else None


def is_topic(name: str) -> bool:
    """Return whether a text is the full name of a ROS topic, such as `/robot1/odom`."""
    return _NAME.fullmatch(name) is not None


def is_topic_expression(name: str) -> bool:
    """Return whether a text is the full name of a ROS topic, perhaps with Zenoh's wildcards."""
    return _TOPIC.fullmatch(name) is not None


ACTION_PARTS = {
    "send_goal": "_SendGoal",
    "cancel_goal": "action_msgs/srv/CancelGoal",
    "get_result": "_GetResult",
    "feedback": "_FeedbackMessage",
    "status": "action_msgs/msg/GoalStatusArray",
}
"""Types of an action's parts by their names below `<action>/_action/`: what the type's name adds to that of the action,
or the type if it is the same for all actions. Source: the design article on actions (design.ros2.org)."""

_ACTION = re.compile(rf"(?P<action>/.+)/_action/(?P<part>{'|'.join(ACTION_PARTS)})")


def action_of(name: str) -> tuple[str, str] | None:
    """Return action and part from the name of a topic or service, None if it does not belong to an action.

    Example:
        >>> action_of("/fibonacci/_action/feedback")
        ('/fibonacci', 'feedback')
    """
    match = _ACTION.fullmatch(name)
    return None if match is None else (match["action"], match["part"])


def action_parts(action: str, type_name: str) -> dict[str, str]:
    """Return the types of an action's topics and services by their names."""
    return {
        f"{action}/_action/{name}": part if "/" in part else f"{type_name}{part}" for name, part in ACTION_PARTS.items()
    }


def action_type(part: str, type_name: str) -> str | None:
    """Return an action's type from that of a part; None if that is the same for all actions or does not fit."""
    ending = ACTION_PARTS[part]
    return type_name.removesuffix(ending) if "/" not in ending and type_name.endswith(ending) else None
