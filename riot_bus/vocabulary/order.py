"""The order of two messages as a condition of a rule: `/arm before /config`."""

from __future__ import annotations

import re
from typing import NamedTuple

_ORDER = re.compile(r"(?P<first>[^:\[\]]+) before (?P<once>the first )?(?P<second>[^:\[\]]+)")


class Order(NamedTuple):
    """A message of topic `first` comes before one of topic `second`, or, with `once`, before the first one of it."""

    first: str
    second: str
    once: bool = False

    def __str__(self) -> str:
        return f"{self.first} before {'the first ' if self.once else ''}{self.second}"


def order_of(name: str) -> Order | None:
    """Return the order that a name describes; None if it is the name of a field."""
    found = _ORDER.fullmatch(name)
    return Order(found["first"], found["second"], found["once"] is not None) if found else None
