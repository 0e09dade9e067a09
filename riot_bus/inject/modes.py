"""Fields that may be modes: they have few values, and what a component does may depend on which one."""

from __future__ import annotations

from collections.abc import Sequence

from riot_bus.types.brittle import why_brittle
from riot_bus.types.by_payload import ByPayload, decoded
from riot_bus.types.model import MessageType
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message, Scalar

MOST_MODES = 6
"""Largest number of values of a mode; a field with more is more likely a count or a measurement."""
_LONG = 64
"""A text of this many characters or more is not a mode."""


def modes_of(message: Message, registry: TypeRegistry) -> Sequence[tuple[str, Scalar]]:
    """Return path and value of each field that may be a mode: truth values, integers and short texts.

    Timestamps, sequence numbers and the like are left out, and so are elements and lengths of arrays.
    """
    return _modes(message, registry) if message.kind == "put" else ()


def _modes_in(kind: MessageType | None, payload: bytes) -> Sequence[tuple[str, Scalar]]:
    return tuple(
        (leaf.path, leaf.value)
        for leaf in decoded.of(kind, payload)
        if (leaf.type in ("bool", "string") or "int" in leaf.type)
        and "[" not in leaf.path
        and "(" not in leaf.path
        and (not isinstance(leaf.value, str) or len(leaf.value) < _LONG)
        and not why_brittle(leaf.path, kind)
    )


_modes = ByPayload(_modes_in)
