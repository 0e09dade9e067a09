"""Summary of a unit's behaviour as seen from outside: the number, the order and the modes of its outputs."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from riot_bus.inject.modes import MOST_MODES, modes_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

__all__ = ["behaviour_of"]

_MOST_NAMES = 64
"""Largest number of topics and fields in a summary, so that a line of the store stays below some KiB."""
_MOST_OUTPUTS = 512
"""Largest number of outputs that are decoded."""


def behaviour_of(outputs: Sequence[Message], registry: TypeRegistry) -> dict[str, list[str]]:
    """Return a summary of the behaviour that outputs show, sorted.

    Args:
        outputs: All outputs of a trial except those of its probe, in their order.
        registry: Registry of topic names and types.

    Returns:
        By `number of TOPIC` the bit length of the number of outputs; by `order` which topic followed which; and by
        `TOPIC:FIELD` the values of a field that has few of them, and which value followed which.
    """
    topics = [registry.topic(message.key) for message in outputs]
    found: dict[str, list[str]] = {
        f"number of {topic}": [str(topics.count(topic).bit_length())] for topic in sorted(set(topics))
    }
    found["order"] = sorted({f"{one} > {other}" for one, other in pairwise(topics)})[:_MOST_NAMES]
    for topic in sorted(set(topics)):
        messages = (message for other, message in zip(topics[:_MOST_OUTPUTS], outputs, strict=False) if other == topic)
        for path, column in sorted(_columns(messages, registry).items()):
            if len(set(column)) <= MOST_MODES:
                found[f"{topic}:{path}"] = sorted({*column, *(f"{one} > {other}" for one, other in pairwise(column))})
    return dict(list(found.items())[:_MOST_NAMES])


def _columns(messages: Iterable[Message], registry: TypeRegistry) -> dict[str, list[str]]:
    """Return the values of a topic's fields wherever they change; stops once all fields have many values."""
    columns: dict[str, list[str]] = {}
    for number, message in enumerate(messages):
        if number > MOST_MODES and all(len(set(column)) > MOST_MODES for column in columns.values()):
            break
        for path, value in modes_of(message, registry):
            column = columns.setdefault(path, [])
            if not column or column[-1] != repr(value):
                column.append(repr(value))
    return columns
