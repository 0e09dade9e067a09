"""Names that users give for the content of a log: topics, new names for them, and points in time."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.selector import key_matches

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.types.capabilities import RecordedTopic
    from riot_bus.types.model import Adapter

_EPOCH_S = 10**8  # March 1973, or three years: no log is that old, and none that long
_LAST_S = 10**11  # the year 5138; milliseconds since 1970 are above it, and refused
_HINT = "write seconds from the beginning, seconds since 1970, or 2026-11-21T10:00:00"


def means(text: str, topic: RecordedTopic) -> bool:
    """Return whether a name or key expression, as a user wrote it, includes a recorded topic."""
    if text in (topic.name, topic.key) or key_matches(text, topic.key):
        return True
    return key_matches(text.strip("/"), topic.name.strip("/"))


def in_full(text: str, topics: Sequence[RecordedTopic], adapters: Callable[[], Sequence[Adapter]]) -> str:
    """Return the key expression that a short name such as MAVLink's `HEARTBEAT` stands for; other names unchanged.

    The adapters, which know short names, are only asked about a text that matches none of the recorded topics.
    """
    if any(means(text, topic) for topic in topics):
        return text
    for adapter in adapters():
        found = adapter.key_expression(text)
        if found is not None and any(means(found, topic) for topic in topics):
            return found
    return text


def parse_remaps(texts: Sequence[str]) -> dict[str, str]:
    """Parse `OLD:=NEW`, both of which may end in `/**`; raises ConfigError if a text is not of this form."""
    found = {}
    for text in texts:
        old, assigned, new = text.partition(":=")
        if not assigned or not old.strip("/") or not new.strip("/") or old.endswith("/**") != new.endswith("/**"):
            hint = "write OLD:=NEW, such as /odom:=/replay/odom or '/robot1/**:=/robot2/**'"
            raise ConfigError(f"{text!r} does not say what to rename", where="--remap", hint=hint)
        found[old] = new
    return found


def renamed(topic: RecordedTopic, remaps: Mapping[str, str]) -> str | None:
    """Return the new name of a topic from the result of `parse_remaps`, None if it keeps its own."""
    bare = topic.name.strip("/")
    for old, new in remaps.items():
        if not old.endswith("/**"):
            if old in (topic.name, topic.key) or old.strip("/") == bare:
                return new
            continue
        prefix = old.removesuffix("/**").strip("/")
        if not prefix or f"{bare}/".startswith(f"{prefix}/"):
            return f"{new.removesuffix('/**')}/{bare.removeprefix(prefix).strip('/')}".rstrip("/")
    return None


def parse_time(text: str, start: int, *, where: str) -> int:
    """Return a time of the logs in nanoseconds; raises ConfigError if the text is none.

    Args:
        text: Seconds from the beginning, seconds since the Unix epoch (from 100 million on), or a date and time in
            ISO 8601; UTC if it has no time zone.
        start: Beginning of the logs, nanoseconds.
        where: Name of the option, for errors.
    """
    try:
        seconds = Decimal(text.strip())
    except InvalidOperation:
        return _moment(text, where)
    if not (seconds.is_finite() and 0 <= seconds < _LAST_S):
        raise ConfigError(f"{text} is no time", where=where, hint=_HINT)
    return int(seconds * 10**9) + (0 if seconds >= _EPOCH_S else start)


def _moment(text: str, where: str) -> int:
    try:
        point = datetime.fromisoformat(text)
    except ValueError:
        raise ConfigError(f"{text!r} is no time", where=where, hint=_HINT) from None
    point = point if point.tzinfo is not None else point.replace(tzinfo=UTC)
    return (point - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000
