"""The fields that all messages of a type have: what a type can say about itself without a payload."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["MOST_FIELDS", "FieldType", "of_numbers"]

MOST_FIELDS = 10_000
"""So many are listed of one type."""

_OBJECTS = frozenset({"string", "bytes"})


@dataclass(frozen=True, slots=True)
class FieldType:
    """A scalar field, or the elements of an array.

    Attributes:
        path: Such as `pose.position.x`, `len(ranges)` or, for the elements of an array, `ranges[*]`.
        type: As in `riot_bus.types.model.Leaf`.
        length: Of an array whose length is fixed, 0 otherwise; of nested arrays, of the innermost.
        low: Smallest value, where the definition says more than the type.
        high: Largest value, likewise; of text and bytes the most bytes, of `len(ranges)` the most elements.
        unit: Such as `m/s`, empty if nothing tells.
    """

    path: str
    type: str
    length: int = 0
    low: float | None = None
    high: float | None = None
    unit: str = ""


def of_numbers(field: FieldType) -> bool:
    """Return whether this stands for the elements of one array of numbers."""
    return field.path.endswith("[*]") and field.path.count("[*]") == 1 and field.type not in _OBJECTS
