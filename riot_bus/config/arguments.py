"""What people write on command lines and in tables of options: sizes, durations, topics with their types."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["parse_seconds", "parse_size", "parse_types"]

_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*(|[kmgt])(i?)b?", re.IGNORECASE)
_TIME = re.compile(r"(\d+(?:\.\d+)?)\s*(|ms|s|m|min|h|d)")
_UNITS = {"": 1.0, "ms": 1e-3, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0, "d": 86400.0}


def parse_size(text: str, where: str) -> int:
    """Return bytes: `500MB`, `1GiB`, `65536`; raises ConfigError."""
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise ConfigError(f"{text!r} is no size", where=where, hint="write it like 500MB, 1GiB or 65536")
    number, letter, binary = match.groups()
    base = 1024 if binary else 1000
    return int(float(number) * base ** " kmgt".index(letter.lower() or " "))


def parse_seconds(text: str, where: str) -> float:
    """Return seconds: `90`, `90s`, `15min`, `15m`, `1h`; raises ConfigError."""
    match = _TIME.fullmatch(text.strip())
    if match is None:
        raise ConfigError(f"{text!r} is no time", where=where, hint="write it like 90, 90s, 15min or 1h")
    return float(match[1]) * _UNITS[match[2]]


def parse_types(texts: Sequence[str]) -> dict[str, str]:
    """Parse `TOPIC=TYPE`.

    Raises:
        ConfigError: A text is not of this form.
    """
    types = {}
    for text in texts:
        topic, equals, type_name = text.rpartition("=")
        if not topic or not equals or not type_name:
            hint = "write TOPIC=TYPE, such as /odom=nav_msgs/msg/Odometry"
            raise ConfigError(f"{text!r} is not a topic and its type", where="--type", hint=hint)
        types[topic] = type_name
    return types
