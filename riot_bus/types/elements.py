"""Reads and sets fields, also all elements of an array at once, and reads quantities of them such as their maximum."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache

from riot_bus.types.model import MessageType
from riot_bus.vocabulary.elements import MOST_ELEMENTS, QUANTITIES, Elements, quantity_of
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.message import Scalar

_ALL_ELEMENTS = 1 << 20  # each takes a `Leaf` and a path, over 100 bytes: 100 MB in all
_NUMBERS = {"nan", "inf", "+inf", "-inf", "infinity", "+infinity", "-infinity"}


def read_field(kind: MessageType, payload: bytes, path: str) -> Scalar:
    """Return a field's value, or a quantity of elements such as `max(ranges[*])`.

    Raises:
        PayloadError: There is no such field or array, or the array has too many elements, or not only numbers.
    """
    quantity = quantity_of(path) if "[*]" in path else None  # fields of messages are read often
    if quantity is None:
        return kind.read(payload, path)
    return QUANTITIES[quantity.kind](read_elements(kind, payload, quantity.path))


def read_elements(kind: MessageType, payload: bytes, path: str) -> Elements:
    """Return the elements of an array, or one field of its records; `path` has one `[*]`, as in `poses[*].x`.

    Raises:
        PayloadError: There is no such array, or it has too many elements, or not only numbers.
    """
    pattern = _pattern(path)
    leaves = kind.leaves(payload, elements=MOST_ELEMENTS + 1)
    length = f"len({path.partition('[*]')[0]})"
    found = [leaf.value for leaf in leaves if pattern.fullmatch(leaf.path)]
    if not found and not any(leaf.path == length for leaf in leaves):
        raise PayloadError("no such array", where=path)
    if len(found) > MOST_ELEMENTS:
        raise PayloadError(f"an array of more than {MOST_ELEMENTS} elements is not judged", where=path)
    numbers = [value for value in found if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) < len(found):
        raise PayloadError("not all elements are numbers", where=path)
    return Elements(numbers)


@lru_cache(maxsize=256)
def _pattern(path: str) -> re.Pattern[str]:
    array, _, rest = path.partition("[*]")
    return re.compile(re.escape(array) + r"\[\d+\]" + re.escape(rest), re.DOTALL)


def set_field(kind: MessageType, payload: bytes, path: str, change: Callable[[Scalar], Scalar]) -> bytes:
    """Return a payload in which a field is set, or all fields that a path with `[*]` stands for.

    Raises:
        PayloadError: There is no such field (other than for an empty array) or too many, or the value does not fit.
    """
    if "[*]" not in path:
        return kind.rebuild(payload, {path: change(kind.read(payload, path))})
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
