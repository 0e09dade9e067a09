"""Recordings made of messages, and what is told of two of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.comparison.compare import Wishes, compare
from riot_bus_logtools.comparison.parts import TopicDifference
from riot_bus_logtools.comparison.recording import Recording
from riot_bus_logtools.comparison.result import LogDifference
from riot_bus_logtools.comparison.tolerances import tolerances_of

BEGIN, MS = 10**18, 10**6


def said(*rows: Mapping[str, Any] | bytes, key: str = "a", begin: int = BEGIN, period: int = MS) -> list[Message]:
    """Messages with these fields, or payloads, one after the other."""
    return [
        Message(
            begin + number * period,
            key,
            row if isinstance(row, bytes) else json.dumps(row).encode(),
            encoding="zenoh/bytes" if isinstance(row, bytes) else "application/json",
            sequence=number,
        )
        for number, row in enumerate(rows)
    ]


def recording(messages: Iterable[Message], name: str = "log") -> Recording:
    known = list(messages)
    return Recording(
        name,
        TypeRegistry(load_adapters()),
        lambda keys: (message for message in known if keys is None or message.key in keys),
    )


def told(a: Sequence[Message], b: Sequence[Message], *tolerances: str, **wishes: Any) -> LogDifference:
    """What is told of two recordings."""
    return compare(recording(a, "a"), recording(b, "b"), Wishes(tolerances=tolerances_of(tolerances), **wishes))


def of_topic(a: Sequence[Any], b: Sequence[Any], *tolerances: str, **wishes: Any) -> TopicDifference:
    """What is told of one topic with these rows."""
    (found,) = told(said(*a), said(*b), *tolerances, **wishes).topics
    return found


def counts(found: TopicDifference) -> tuple[int, int, int, int, int]:
    """Equal, changed, lost, added and moved messages."""
    return found.equal, found.changed, found.lost, found.added, found.moved
