"""Arrays of numbers as a whole, and what a rule tells of their elements: the largest, the smallest, whether any is NaN.

Such a quantity is written `max(ranges[*])`, or `max(poses[*].x)` of records, and read like a field.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Final, NamedTuple

from riot_bus.vocabulary.message import Scalar

__all__ = ["MOST_ELEMENTS", "QUANTITIES", "Elements", "Quantity", "Setting", "is_counted", "quantity_of"]

MOST_ELEMENTS = 1024
"""Arrays with more elements than this are not judged: images and point clouds would take seconds a message."""


class Elements(tuple[int | float, ...]):
    """The elements of one array of numbers, or one field of all records of an array."""

    @cached_property
    def key(self) -> str:
        """What tells it from other ones bit by bit (NaN equals itself, -0.0 is not 0.0, 1.0 is not 1)."""
        return repr(tuple(self))

    @cached_property
    def _numbers(self) -> tuple[int | float, ...]:
        return tuple(value for value in self if value == value)

    @cached_property
    def largest(self) -> int | float:
        """The largest element that is a number; NaN if none is."""
        return max(self._numbers, default=math.nan)

    @cached_property
    def smallest(self) -> int | float:
        """The smallest element that is a number; NaN if none is."""
        return min(self._numbers, default=math.nan)

    @property
    def any_nan(self) -> bool:
        """Whether any element is NaN."""
        return len(self._numbers) < len(self)

    @property
    def any_odd(self) -> bool:
        """Whether any element is NaN or infinite."""
        return self.any_nan or math.inf in (self.largest, -self.smallest)


Setting = Scalar | Elements
"""What a field, or the elements of an array, can be set to."""

QUANTITIES: Final[Mapping[str, Callable[[Elements], Scalar]]] = {
    "max": lambda elements: elements.largest,
    "min": lambda elements: elements.smallest,
    "isnan": lambda elements: elements.any_nan,
    "nonfinite": lambda elements: elements.any_odd,
}
"""By name: the largest and the smallest of the elements that are numbers (NaN where none is); whether any is odd."""

_QUANTITY = re.compile(
    r"(?P<topic>(?:.*:)?)(?P<kind>max|min|isnan|nonfinite)\((?P<path>[^:]*\[\*\][^:]*)\)\Z", re.DOTALL
)


def is_counted(name: str) -> bool:
    """Return whether a name is of something that is read from an array, and cannot be set: its length, its largest."""
    return name.rpartition(":")[2].startswith("len(") or quantity_of(name) is not None


class Quantity(NamedTuple):
    """A name taken apart: `/scan:max(ranges[*])` is of the topic `/scan:` the `max` of `ranges[*]`."""

    topic: str
    kind: str
    path: str


def quantity_of(name: str) -> Quantity | None:
    """Return the parts of the name of a quantity of elements, with or without a topic; None if it is another name."""
    if "[*]" not in name:
        return None
    found = _QUANTITY.match(name)
    return Quantity(found["topic"], found["kind"], found["path"]) if found else None
