"""Situations of a log: the times while a field with few values, such as a mode, has one of them."""

from __future__ import annotations

import json
import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from riot_bus.campaign.schedule import positions_of
from riot_bus.inject.modes import MOST_MODES, modes_of
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message, Scalar

_SAMPLES = 400
"""Messages of a topic that are read, evenly spaced: a second at most for large ones; short situations are missed."""


class Window(NamedTuple):
    """A stretch of a log: positions of its first message and of the first one after it; seconds since its log began."""

    first: int
    behind: int
    start: float
    end: float | None


@dataclass(frozen=True, slots=True)
class Situation:
    """The time while a field has a value, by the last message of its topic.

    Attributes:
        windows: Stretches of the log in which it has the value.
        where: Predicate for messages of the topic itself; empty if there is none.
    """

    topic: str
    path: str
    windows: tuple[Window, ...]
    where: str


def situations_of(messages: Sequence[Message], registry: TypeRegistry) -> list[Situation]:
    """Return the situations of a log: one for each value of each field with few values.

    Truth values, integers and short texts count; stamps, message numbers and the like, and elements of arrays do not.
    """
    found: list[Situation] = []
    for topic, positions in sorted(positions_of(messages, registry).items()):
        columns: dict[str, list[tuple[int, Scalar]]] = {}
        values: dict[str, set[Scalar]] = {}
        for position in positions[:: max(1, len(positions) // _SAMPLES)]:
            for path, value in modes_of(messages[position], registry):
                seen = values.setdefault(path, set())
                seen.add(value)
                if len(seen) <= MOST_MODES:
                    columns.setdefault(path, []).append((position, value))
        for path, column in sorted(columns.items()):
            if 1 < len(values[path]) <= MOST_MODES:
                found += _of_field(topic, path, column, messages)
    return found


def numbers_within(window: Window, positions: Sequence[int]) -> range:
    """Return the numbers of a topic's messages that lie in a window; `positions` are those of all its messages."""
    return range(bisect_left(positions, window.first), bisect_left(positions, window.behind))


def _of_field(
    topic: str, path: str, column: Sequence[tuple[int, Scalar]], messages: Sequence[Message]
) -> list[Situation]:
    changes = [column[0], *(after for before, after in pairwise(column) if before[1] != after[1])]
    ends: list[int | None] = [*(position for position, _ in changes[1:]), None]
    windows: dict[Scalar, list[Window]] = {}
    for (first, value), behind in zip(changes, ends, strict=True):
        start, end = _seconds(messages, first), None if behind is None else _seconds(messages, behind)
        windows.setdefault(value, []).append(Window(first, len(messages) if behind is None else behind, start, end))
    return [Situation(topic, path, tuple(each), _predicate(path, value)) for value, each in windows.items()]


def _seconds(messages: Sequence[Message], position: int) -> float:
    """Return the time of a message, rounded down to microseconds, so that a window from there contains it."""
    return math.floor((messages[position].time - messages[0].time) / 1e3) / 1e6


def _predicate(path: str, value: Scalar) -> str:
    literal = json.dumps(value)
    return "" if "\\" in literal else f"{path} == {literal}"
