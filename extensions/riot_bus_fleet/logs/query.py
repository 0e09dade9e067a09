"""Queries for logs of a catalogue: `robot=r7 topic=/odom after=2026-11-01 min-duration=5m lossless`.

Words are joined by "and". Texts are compared literally, except that `*` stands for any letters and `?` for one. What
users write becomes parameters of an SQL statement, never a part of it.
"""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from riot_bus.vocabulary.errors import ConfigError, did_you_mean

_UNITS = {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}  # in seconds
_SPAN = re.compile(r"(\d{1,12}(?:\.\d{1,9})?)([smhd]?)")
_LATEST_S = 9e9  # in nanoseconds still an integer of SQLite, which ends at 2**63 (9.22e18)
_LONGEST = 1000  # a guess: more than topics and types have; SQLite refuses patterns beyond 50,000 bytes
_MOST_WORDS = 100  # two parameters each at most: far below 999, the limit of older versions of SQLite

_HAS_TOPIC = "EXISTS (SELECT 1 FROM topics t WHERE t.log = logs.number AND t.count > 0 AND {})"
_TEXTS = {
    "robot": "robot GLOB ?1",
    "path": "place GLOB ?1",
    "topic": _HAS_TOPIC.format("(ltrim(t.topic, '/') GLOB ?1 OR ltrim(t.key, '/') GLOB ?1)"),
    "type": _HAS_TOPIC.format("t.type GLOB ?1"),
}
_EITHER = ("robot", "path")
_FLAGS = {
    "lossless": "readable AND problem = '' AND lost = 0",
    "damaged": "(problem != '' OR lost > 0)",
    "gone": "gone",
}


@dataclass(frozen=True, slots=True)
class Query:
    """A query to a catalogue.

    Attributes:
        condition: SQL over the table `logs`, made of fixed parts.
    """

    text: str = ""
    condition: str = "NOT gone"
    parameters: tuple[str | int | float, ...] = ()


def parse_query(words: Sequence[str] | str, *, now: float | None = None) -> Query:
    """Parse a query.

    Args:
        words: One text, or several, of words as in a shell; none means all logs that exist.
        now: Current time, in seconds since the Unix epoch; `7d` means seven days before it.

    Raises:
        ConfigError: A word is not part of the query language, or a quote is not closed.
    """
    text = words if isinstance(words, str) else " ".join(words)
    try:
        parts = shlex.split(text)
    except ValueError as error:
        raise ConfigError(
            f"{text!r}: {error}", where="query", hint="close each quote, and write no backslash at the end"
        ) from None
    if len(parts) > _MOST_WORDS:
        raise ConfigError(f"{len(parts)} words are too many", where="query", hint=f"at most {_MOST_WORDS}")
    conditions: dict[str, list[str]] = {}
    parameters: dict[str, list[str | int | float]] = {}
    for part in parts:
        name, condition, values = _term(part, time.time() if now is None else now)
        conditions.setdefault(name, []).append(condition)
        parameters.setdefault(name, []).extend(values)
    if "gone" not in conditions:
        conditions["gone"] = ["NOT gone"]
    joined = [f"({' OR '.join(some)})" if name in _EITHER else " AND ".join(some) for name, some in conditions.items()]
    return Query(text, " AND ".join(joined), tuple(value for name in conditions for value in parameters.get(name, ())))


def _term(word: str, now: float) -> tuple[str, str, list[str | int | float]]:
    """Return the name in a word, and its condition and parameters."""
    name, equals, value = word.partition("=")
    if name in _FLAGS and not equals:
        return name, _FLAGS[name], []
    if name in _TEXTS and value:
        if len(value) > _LONGEST or not value.isprintable():
            raise ConfigError("this text cannot be looked for", where=f"query: {name}", hint=f"at most {_LONGEST}")
        pattern = value.lstrip("/") if name == "topic" else value
        condition = _TEXTS[name]
        return name, condition.replace("?1", "?"), [pattern] * condition.count("?1")
    if name in _NUMBERS and value:
        condition, convert = _NUMBERS[name]
        return name, condition, [convert(value, name, now)]
    hint = did_you_mean(word if not equals else name, [*_TEXTS, *_NUMBERS, *_FLAGS])
    what = f"{name!r} needs a value" if name in _TEXTS or name in _NUMBERS else f"{word[:80]!r} is not a condition"
    if name in _FLAGS:
        what, hint = f"{name!r} takes no value", f"write {name}"
    raise ConfigError(what, where="query", hint=f"{name}=..." if "needs a value" in what else hint)


def _time(text: str, name: str, now: float) -> int:
    span = _SPAN.fullmatch(text)
    if span is not None and span[2]:
        seconds = now - float(span[1]) * _UNITS[span[2]]
    elif span is not None and float(span[1]) >= 1e8:  # smaller numbers are dates such as 20261121
        seconds = float(span[1])
    else:
        try:
            point = datetime.fromisoformat(text)
            seconds = (point if point.tzinfo is not None else point.replace(tzinfo=UTC)).timestamp()
        except (ValueError, OverflowError):
            hint = "write 2026-11-21, 2026-11-21T10:00:00 (UTC if it does not say), or 7d: so long ago"
            raise ConfigError(f"{text[:80]!r} is not a time", where=f"query: {name}", hint=hint) from None
    return int(min(max(seconds, 0.0), _LATEST_S) * 1e9)


def _span(text: str, name: str, _: float) -> int:
    found = _SPAN.fullmatch(text)
    if found is None:
        hint = "write seconds, or 90s, 5m, 2h, 1d"
        raise ConfigError(f"{text[:80]!r} is not a duration", where=f"query: {name}", hint=hint)
    return int(min(float(found[1]) * _UNITS[found[2]], _LATEST_S) * 1e9)


def _count(text: str, name: str, _: float) -> int:
    if not text.isascii() or not text.isdecimal() or len(text) > 18:
        raise ConfigError(f"{text[:80]!r} is not a number", where=f"query: {name}")
    return int(text)


_NUMBERS: dict[str, tuple[str, Callable[[str, str, float], int]]] = {
    "after": ("ended >= ?", _time),
    "before": ("began < ?", _time),
    "min-duration": ("ended - began >= ?", _span),
    "max-duration": ("ended - began <= ?", _span),
    "min-messages": ("messages >= ?", _count),
}
