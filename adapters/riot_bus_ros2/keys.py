"""Data keys of rmw_zenoh: `<domain>/<topic>/<dds type>/<type hash>`.

Source: docs/design.md of ros2/rmw_zenoh. The topic may have any number of chunks, so the key is parsed from the right.
Buffer-aware endpoints (2026) append `_buf_cpu` or `_buf/<subscriber gid>`; Humble writes `TypeHashNotSupported`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

__all__ = ["NO_HASH", "DataKey", "build_data_key", "is_topic", "key_expression", "parse_data_key"]

NO_HASH = "TypeHashNotSupported"

_KEY = re.compile(
    r"(?P<domain>[0-9]{1,9})/(?P<topic>.+)/"
    r"(?P<package>[A-Za-z]\w*)::(?P<kind>msg|srv|action)::dds_::(?P<type>[A-Za-z]\w*)_/"
    rf"(?P<hash>RIHS[0-9]{{2}}_[0-9a-f]+|{NO_HASH})"
    r"(?:/(?P<suffix>_buf_cpu|_buf/[0-9a-f]+))?",
    re.ASCII,
)
_TOPIC = re.compile(r"/[^/\s#?:]+(?:/[^/\s#?:]+)*")
_NAME = re.compile(r"(?:/\w+)+", re.ASCII)


@dataclass(frozen=True, slots=True)
class DataKey:
    """A topic or service of one ROS domain; `type_hash` is None where the distribution has none."""

    domain: int
    topic: str
    type_name: str
    type_hash: str | None = None
    suffix: str = ""


def parse_data_key(key: str) -> DataKey | None:
    """Return what a key says, None if it is not rmw_zenoh's.

    Example:
        >>> parse_data_key("0/robot1/odom/nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported").topic
        '/robot1/odom'
    """
    match = _KEY.fullmatch(key)
    if match is None:
        return None
    domain, topic, package, kind, name, type_hash, suffix = match.groups()
    return DataKey(
        domain=int(domain),
        topic=f"/{topic}",
        type_name=f"{package}/{kind}/{name}",
        type_hash=None if type_hash == NO_HASH else type_hash,
        suffix=suffix or "",
    )


def build_data_key(key: DataKey) -> str:
    """Return the key that `parse_data_key` reads."""
    package, kind, name = key.type_name.split("/")
    parts = [str(key.domain), key.topic.strip("/"), f"{package}::{kind}::dds_::{name}_", key.type_hash or NO_HASH]
    return "/".join([*parts, key.suffix] if key.suffix else parts)


def key_expression(topic: str, *, domain: int | None = None) -> str | None:
    """Return the key expression of a ROS topic name in any domain, with any type and hash.

    Args:
        topic: Name that begins with `/`; Zenoh's wildcards are allowed.
        domain: Only this ROS domain.

    Returns:
        None if the text is no ROS topic name.

    Example:
        >>> key_expression("/odom")
        '*/odom/*/*'
    """
    if _TOPIC.fullmatch(topic) is None:
        return None
    return f"{'*' if domain is None else domain}{topic}/*/*"


def is_topic(name: str) -> bool:
    """Return whether a text is the full name of a ROS topic, such as `/robot1/odom`."""
    return _NAME.fullmatch(name) is not None
