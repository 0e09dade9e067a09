"""Fits values to the fields that they are for, and sets many elements of arrays at once."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache

from riot_bus.types.model import MessageType
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Scalar

_ALL_ELEMENTS = 1 << 20  # each takes a `Leaf` and a path, over 100 bytes: 100 MB in all
_NUMBERS = {"nan", "inf", "+inf", "-inf", "infinity", "+infinity", "-infinity"}


def set_elements(kind: MessageType, payload: bytes, path: str, change: Callable[[Scalar], Scalar]) -> bytes:
    """Return a payload in which all fields that a path with `[*]` stands for are set.

    Raises:
        PayloadError: There are no such fields (other than for an empty array) or too many, or the value does not fit.
    """
    fields, lengths = _patterns(path)
    changes = {}
    for leaf in kind.leaves(payload, elements=_ALL_ELEMENTS):
        if fields.fullmatch(leaf.path):
            changes[leaf.path] = change(leaf.value)
        elif isinstance(leaf.value, int) and leaf.value > _ALL_ELEMENTS and lengths.fullmatch(leaf.path):
            raise PayloadError(f"{leaf.value} elements are more than the {_ALL_ELEMENTS} that can be set", where=path)
    if not changes:
        _check_elements(kind, payload, path)
    return kind.rebuild(payload, changes)


@lru_cache(maxsize=256)
def _patterns(path: str) -> tuple[re.Pattern[str], re.Pattern[str]]:
    """Return the patterns of the fields that a path with `[*]` stands for, and of the lengths of its arrays."""
    escaped = re.escape(path).replace(r"\[\*\]", r"\[\d+\]")
    places = re.finditer(r"\\\[\\d\+\\\]", escaped)
    arrays = "|".join(escaped[: place.start()] for place in places)
    return re.compile(escaped), re.compile(rf"len\((?:{arrays})\)")


def _check_elements(kind: MessageType, payload: bytes, path: str) -> None:
    """Raise PayloadError unless a path stands for no fields because an array is empty."""
    array, star, rest = path.partition("[*]")
    while star:
        if not kind.read(payload, f"len({array})"):
            return
        more, star, rest = rest.partition("[*]")
        array = f"{array}[0]{more}"
    kind.read(payload, array)


def fit_value(value: Scalar, before: Scalar) -> Scalar:
    """Convert a value to the field's kind: `"nan"` becomes a number if the field is one, 2.0 an integer."""
    if isinstance(before, float):
        if isinstance(value, str) and value.strip().lower() in _NUMBERS:
            return float(value)
        return float(value) if isinstance(value, int) and abs(value) < 2**1023 else value
    if isinstance(before, bool):
        return bool(value) if isinstance(value, int) or value in (0.0, 1.0) else value
    if isinstance(before, int) and isinstance(value, float) and value.is_integer():
        return int(value)
    return value
