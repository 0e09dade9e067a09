"""Metadata of ROS topics for a recorder: numbers and times from attachments, and QoS from liveliness tokens.

Source: attachment_helpers.cpp, liveliness_utils.cpp and qos.cpp of ros2/rmw_zenoh.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from riot_bus.types.capabilities import Stamp
from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.attachment import parse_attachment
from riot_bus_ros2.keys import parse_data_key
from riot_bus_ros2.qos import RosQos
from riot_bus_ros2.tokens import TOKENS, NodeEndpoint, parse_token

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["TOKENS", "definition_of", "details_of", "profiles_of", "stamp_of"]

_V2 = struct.Struct("<qqB16s")
_GID = 16  # bytes of a gid, a hash of 128 bits (gid.py)
_MOST_PROFILES = 64  # a guess: tokens can be forged, and each would make the log's metadata longer


def stamp_of(attachment: bytes) -> Stamp | None:
    """Return number, time and publisher of a message, None if these are not the bytes of an attachment."""
    if len(attachment) == _V2.size:
        sequence, time, size, gid = _V2.unpack(attachment)
        return Stamp(sequence, time, gid) if size == _GID else None
    try:
        found = parse_attachment(attachment)
    except PayloadError:
        return None
    return Stamp(found.sequence, found.source_time, found.gid)


def details_of(key: str, tokens: Iterable[str]) -> dict[str, str]:
    """Return the offered QoS of all publishers of a key, as rosbag2 writes it; empty if there is none.

    Args:
        key: A data key of rmw_zenoh.
        tokens: Liveliness tokens.
    """
    wanted = parse_data_key(key)
    if wanted is None:
        return {}
    name = f"/{wanted.topic.replace('/', '%')}/"
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


def definition_of(key: str) -> tuple[Schema, str] | None:
    """Return the name of a key's type without a definition, for types that are unknown here, and the encoding."""
    found = parse_data_key(key)
    return None if found is None else (Schema(found.type_name, "ros2msg", b""), "cdr")
