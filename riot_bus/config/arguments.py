"""What people write on command lines and in tables of options: sizes, durations, topics with their types."""

from __future__ import annotations

import re
from collections.abc import Sequence

from riot_bus.vocabulary.errors import ConfigError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a router of this machine listens: Zenoh's own port, segment `system` of `riot router`."""

_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*(|[kmgt])(i?)b?", re.IGNORECASE)
_TIME = re.compile(r"(\d+(?:\.\d+)?)\s*(|ms|s|m|min|h|d)")
_UNITS = {"": 1.0, "ms": 1e-3, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0, "d": 86400.0}  # in seconds


def parse_size(text: str, where: str) -> int:
    """Return bytes: `500MB`, `1GiB`, `65536`; raises ConfigError."""
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise ConfigError(f"{text!r} is not a size", where=where, hint="write it like 500MB, 1GiB or 65536")
    number, letter, binary = match.groups()
    base = 1024 if binary else 1000
    return int(float(number) * base ** " kmgt".index(letter.lower() or " "))


def size_text(size: float) -> str:
    """Return a size in bytes as human-readable text, in a form that `parse_size` reads.

    Example:
        >>> size_text(999), size_text(1500), size_text(2_000_000)
        ('999 B', '1.5 kB', '2.0 MB')
    """
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} TB"


def parse_seconds(text: str, where: str) -> float:
    """Return seconds: `90`, `90s`, `15min`, `15m`, `1h`; raises ConfigError."""
    match = _TIME.fullmatch(text.strip())
    if match is None:
        raise ConfigError(f"{text!r} is not a time", where=where, hint="write it like 90, 90s, 15min or 1h")
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
