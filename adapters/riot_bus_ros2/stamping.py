"""What a recorder can know of ROS topics: numbers and times from attachments, and QoS from liveliness tokens.

Source: attachment_helpers.cpp, liveliness_utils.cpp and qos.cpp of ros2/rmw_zenoh.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from riot_bus.errors import PayloadError
from riot_bus.types.model import Schema
from riot_bus.types.stamp import Stamp
from riot_bus_ros2.attachment import parse_attachment
from riot_bus_ros2.keys import DataKey, parse_data_key

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["TOKENS", "definition_of", "details_of", "profile_of", "stamp_of"]

TOKENS = "@ros2_lv/**"
"""Key expression of the tokens of all ROS nodes and their publishers."""

_V2 = struct.Struct("<qqB16s")
_GID = 16
_CHUNKS = 12
_MOST_PROFILES = 64
_FOREVER = (9223372036, 854775807)
_MOST_DIGITS = 10


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
    """Return the offered QoS of all publishers of a key, as rosbag2 writes it; nothing if there is none.

    Args:
        key: A data key of rmw_zenoh.
        tokens: Liveliness tokens.
    """
    wanted = parse_data_key(key)
    if wanted is None:
        return {}
    profiles = []
    topic = f"/{wanted.topic.replace('/', '%')}/"
    for token in sorted(each for each in tokens if topic in each and "/MP/" in each):
        chunks = token.split("/")
        if len(chunks) >= _CHUNKS + 1 and chunks[0] == "@ros2_lv" and chunks[5] == "MP" and _is_of(chunks, wanted):
            profiles.append(profile_of(chunks[_CHUNKS]))
    return {"offered_qos_profiles": "".join(profiles[:_MOST_PROFILES])} if profiles else {}


def definition_of(key: str) -> tuple[Schema, str] | None:
    """Return the name of a key's type without a definition, for types that are unknown here, and the encoding."""
    found = parse_data_key(key)
    return None if found is None else (Schema(found.type_name, "ros2msg", b""), "cdr")


def profile_of(text: str) -> str:
    """Return a QoS profile in YAML, with rmw's numbers, from the last chunk of a publisher's token.

    Args:
        text: `reliability:durability:history,depth:deadline:lifespan:liveliness,lease`; what is empty is rmw_zenoh's
            default.
    """
    parts = (text.split(":") + [""] * 6)[:6]
    history, depth = _numbers(parts[2], (1, 42))
    liveliness, *lease = _numbers(parts[5], (1, *_FOREVER))
    lines = [
        f"- history: {history}",
        f"  depth: {depth}",
        f"  reliability: {_numbers(parts[0], (1,))[0]}",
        f"  durability: {_numbers(parts[1], (2,))[0]}",
        *_duration("deadline", _numbers(parts[3], _FOREVER)),
        *_duration("lifespan", _numbers(parts[4], _FOREVER)),
        f"  liveliness: {liveliness}",
        *_duration("liveliness_lease_duration", lease),
        "  avoid_ros_namespace_conventions: false",
    ]
    return "\n".join(lines) + "\n"


def _is_of(chunks: list[str], key: DataKey) -> bool:
    package, kind, name = key.type_name.split("/")
    type_name = f"{package}::{kind}::dds_::{name}_"
    domain, topic, dds_type = chunks[1], chunks[9].replace("%", "/"), chunks[10]
    return (domain, topic, dds_type) == (str(key.domain), key.topic, type_name)


def _numbers(text: str, defaults: tuple[int, ...]) -> list[int]:
    found = [int(part) if part.isdecimal() and len(part) <= _MOST_DIGITS else None for part in text.split(",")]
    return [
        default if place >= len(found) or found[place] is None else int(found[place] or 0)
        for place, default in enumerate(defaults)
    ]


def _duration(name: str, numbers: list[int]) -> list[str]:
    seconds, nanoseconds = numbers
    return [f"  {name}:", f"    sec: {seconds}", f"    nsec: {nanoseconds}"]
