"""Fields that are better left alone.

A wrong timestamp, sequence number, checksum or signature makes a component reject the whole message early, which hides
other faults. Such fields are injected only when the user names them.
"""

from __future__ import annotations

import re
from functools import cache, lru_cache
from typing import cast

from riot_bus.types.capabilities import KnowsBrittleFields
from riot_bus.types.model import MessageType

STAMPS = ("header stamp", "timestamp")
"""Reasons that apply to time fields."""

_REASONS = {
    "header stamp": r"stamps?",
    "timestamp": r"(\w+_)?timestamps?(_\w+)?|time_((boot|unix|since_boot)_)?(ns|us|usec|ms|msec|nsec)|utc_?time",
    "sequence number": r"seq|seq(uence)?_?(no|nr|num|number|id|count|counter)|sequence|message_id|msg_id",
    "frame id": r"(\w+_)?frame_?id",
    "checksum": r"(\w+_)?(checksum|crc(8|16|32|64)?|md5|sha(1|256|512)?|hmac|digest)",
    "version": r"(\w+_)?version(_\w+)?",
    "protocol signature": r"(\w+_)?(signature|magic(_number)?|protocol(_id)?)",
}
_PATTERNS = {reason: re.compile(pattern) for reason, pattern in _REASONS.items()}
_TYPES = {
    "builtin_interfaces/Time": "timestamp",
    "std_msgs/Header": "header stamp",
    "rosgraph_msgs/Clock": "timestamp",
}
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


@lru_cache(maxsize=1 << 14)
def is_brittle(path: str, type_name: str | None = None) -> str | None:
    """Return why a field should be left alone unless the user names it, None if it may be injected.

    Every part of the path counts, so `header.stamp.sec` is brittle because of `stamp`; all fields of some types are.
    """
    if type_name is not None:
        reason = _TYPES.get(type_name.replace("/msg/", "/"))
        if reason is not None:
            return reason
    inner = path[4:-1] if path.startswith("len(") else path
    for part in re.sub(r"\[[^]]*\]", "", inner).split("."):
        word = _CAMEL.sub("_", part).lower().strip("_")
        for reason, pattern in _PATTERNS.items():
            if pattern.fullmatch(word):
                return reason
    return None


def why_brittle(path: str, kind: MessageType | None = None) -> str | None:
    """Return why a field should be left alone, according to its type or else its name; None if it may be injected."""
    told = cast("KnowsBrittleFields", kind).brittle(path) if kind and _knows(type(kind)) else None
    return is_brittle(path) if told is None else told or None


@cache
def _knows(kind: type[object]) -> bool:
    """Return whether objects of a class know brittle fields: to ask an object takes ten times as long as the rest."""
    return issubclass(kind, KnowsBrittleFields)
