"""Selectors: one language for choosing messages and fields in every command.

`KEYEXPR[:FIELD][ where PREDICATE]`, for example `/odom:twist.twist.linear.x where pose.pose.position.x > 3`. A key
expression is Zenoh's (`*` one chunk, `**` any number, `$*` within a chunk); a name that begins with `/` is a ROS topic.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from riot_bus.vocabulary.errors import ConfigError

_STEP = r"[A-Za-z_][A-Za-z0-9_]*(\[(\d{1,18}|\*)\])*"  # 18 digits fit into 64 bits
_FIELD = re.compile(rf"((?:len|max|min|isnan|nonfinite)\()?{_STEP}(\.{_STEP})*\)?")

_SPLIT = re.compile(r"((?:[^:]|::)*+)(?::(.*))?", re.DOTALL)  # `::` belongs to type names in ROS 2 keys

_ANY_CHUNKS = r"(?:/(?!@)[^/]*)"


_MOST_CHUNKS = 32
"""Chunks around a `**`: to compare two expressions of 511 took Zenoh 0.7 s; the time grows with the third power."""


@dataclass(frozen=True, slots=True)
class Selector:
    """A choice of messages (`topic`, `where`), and of one of their fields."""

    topic: str
    field: str | None = None
    where: str | None = None

    def __str__(self) -> str:
        text = self.topic if self.field is None else f"{self.topic}:{self.field}"
        return text if self.where is None else f"{text} where {self.where}"


def parse_selector(text: str) -> Selector:
    """Parse `KEYEXPR[:FIELD][ where PREDICATE]`.

    Raises:
        ConfigError: The text is not a selector; the message names the offending part.
    """
    body, _, where = text.partition(" where ")
    topic, path = split_field(body.strip())
    if not topic:
        raise ConfigError(f"selector {text!r} names no topic", hint="write KEYEXPR[:FIELD], such as '/odom:pose'")
    if body.strip() != topic and not _FIELD.fullmatch(path):
        raise ConfigError(f"{path!r} in selector {text!r} is not a field path", hint="write it like 'scan.ranges[3]'")
    return Selector(topic, path or None, where.strip() or None)


def split_field(text: str) -> tuple[str, str]:
    """Return the topic and the field of `KEYEXPR[:FIELD]`; the field is empty if there is none.

    Example:
        >>> split_field("0/odom/nav_msgs::msg::dds_::Odometry_/*:pose.x")
        ('0/odom/nav_msgs::msg::dds_::Odometry_/*', 'pose.x')
    """
    found = _SPLIT.match(text)
    assert found is not None  # it matches every text
    return found[1], found[2] or ""


def check_wildcards(expression: str) -> None:
    """Raise ConfigError if Zenoh could take long to match a canonical key expression.

    Zenoh 1.10.2 tries all ways to match: time grows with a power of the key's length, one for each `$*` of a chunk and
    each `**`. One at the end costs nothing.
    """
    chunks = expression.split("/")
    inner = chunks[:-1].count("**")
    many = any(each.removesuffix("$*").count("$*") > 1 for each in chunks)
    if many or inner > 1 or (inner and len(chunks) > _MOST_CHUNKS):
        hint = f"before its end, a chunk has at most one $*, and an expression one ** and {_MOST_CHUNKS} chunks with it"
        raise ConfigError(f"{expression[:200]!r} has too many wildcards for Zenoh", hint=hint)


@lru_cache(maxsize=4096)
def _pattern(expression: str) -> re.Pattern[str]:
    """Compile a key expression to a pattern whose matching never backtracks over more than one wildcard.

    The text between two wildcards is matched at its first occurrence, in an atomic group: a later one could not help
    the rest. So the time does not grow with powers of the key's length, however many wildcards there are.
    """
    groups: list[str] = [""]  # chunks between two `**`
    for chunk in expression.split("/"):
        if chunk == "**":
            groups.append("")
        elif chunk == "*":
            groups[-1] += r"/(?!@)[^/]+"
        else:
            groups[-1] += "/" + _chunk_pattern(chunk)
    first, *between = groups
    if not between:
        return re.compile(first)
    found = "".join(f"(?>{_ANY_CHUNKS}*?{group})" for group in between[:-1] if group)
    return re.compile(f"{first}{found}{_ANY_CHUNKS}*{between[-1]}")


def _chunk_pattern(chunk: str) -> str:
    first, *between = map(re.escape, chunk.split("$*"))
    if not between:
        return first
    *found, last = between
    steps = "".join(f"(?>[^/]*?{text})" for text in found if text)
    return rf"(?!@){first}{steps}(?>[^/]*{last}(?=/|\Z))"


def key_matches(expression: str, key: str) -> bool:
    """Return whether a Zenoh key expression includes `key` (wildcards never match `@` chunks)."""
    return expression == key or _pattern(expression).fullmatch("/" + key) is not None
