"""Arrays of numbers, and quantities of their elements for rules: the largest, the smallest, whether any is NaN.

Such a quantity is written `max(ranges[*])`, or `max(poses[*].x)` for arrays of records, and read like a field.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Final, NamedTuple

from riot_bus.vocabulary.message import Scalar

MOST_ELEMENTS = 1024
"""Largest number of elements that is judged: images and point clouds would take seconds for each message."""


class Elements(tuple[int | float, ...]):
    """The elements of one array of numbers, or one field of all records of an array."""

    @cached_property
    def key(self) -> str:
        """Key for exact comparison (NaN equals itself, -0.0 is not 0.0, 1.0 is not 1)."""
        return repr(tuple(self))

    @cached_property
    def _numbers(self) -> tuple[int | float, ...]:
        return tuple(value for value in self if value == value)

    @cached_property
    def largest(self) -> int | float:
        """Largest element that is not NaN; NaN if there is none."""
        return max(self._numbers, default=math.nan)

    @cached_property
    def smallest(self) -> int | float:
        """Smallest element that is not NaN; NaN if there is none."""
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
"""Value to which a field, or the elements of an array, can be set."""

QUANTITIES: Final[Mapping[str, Callable[[Elements], Scalar]]] = {
    "max": lambda elements: elements.largest,
    "min": lambda elements: elements.smallest,
    "isnan": lambda elements: elements.any_nan,
    "nonfinite": lambda elements: elements.any_odd,
}
"""Quantities by name: the largest and the smallest element that is not NaN; whether any is NaN, or not finite."""

_QUANTITY = re.compile(
    r"(?P<topic>(?:.*:)?)(?P<kind>max|min|isnan|nonfinite)\((?P<path>[^:]*\[\*\][^:]*)\)\Z", re.DOTALL
)


def is_counted(name: str) -> bool:
    """Return whether a name means the length or a quantity of an array, which can be read but not set."""
    return name.rpartition(":")[2].startswith("len(") or quantity_of(name) is not None


class Quantity(NamedTuple):
    """The parts of a quantity's name: `/scan:max(ranges[*])` has topic `/scan:`, kind `max` and path `ranges[*]`."""

    topic: str
    kind: str
    path: str


def quantity_of(name: str) -> Quantity | None:
    """Return the parts of a quantity's name, with or without a topic; None for any other name."""
    if "[*]" not in name:
        return None
    found = _QUANTITY.match(name)
    return Quantity(found["topic"], found["kind"], found["path"]) if found else None
