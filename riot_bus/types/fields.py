"""The fields that all messages of a type have, known without a payload."""

from __future__ import annotations

from dataclasses import dataclass

MOST_FIELDS = 10_000
"""Largest number of fields listed for one type."""

_OBJECTS = frozenset({"string", "bytes"})


@dataclass(frozen=True, slots=True)
class FieldType:
    """A scalar field, or the elements of an array.

    Attributes:
        path: Field path such as `pose.position.x`, `len(ranges)` or, for the elements of an array, `ranges[*]`.
        type: Type name as in `riot_bus.types.model.Leaf`.
        length: Length of an array of fixed length (of the innermost of nested arrays), otherwise 0.
        low: Smallest value, if the definition restricts the type.
        high: Largest value, if the definition restricts the type; for text and bytes the largest number of bytes, for
            `len(ranges)` the largest number of elements.
        unit: Unit such as `m/s`, empty if unknown.
        names: Values that have a name in the definition, each with it, such as those of an enum.
    """

    path: str
    type: str
    length: int = 0
    low: float | None = None
    high: float | None = None
    unit: str = ""
    names: tuple[tuple[int, str], ...] = ()


def of_numbers(field: FieldType) -> bool:
    """Return whether a field represents the elements of one array of numbers."""
    return field.path.endswith("[*]") and field.path.count("[*]") == 1 and field.type not in _OBJECTS
