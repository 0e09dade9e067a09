"""The order of two messages as something that a rule tells: `/arm before /config`."""

from __future__ import annotations

import re
from typing import NamedTuple

__all__ = ["Order", "order_of"]

_ORDER = re.compile(r"(?P<first>[^:\[\]]+) before (?P<once>the first )?(?P<second>[^:\[\]]+)")


class Order(NamedTuple):
    """A message of one topic has come before one of another, or, with `once`, before the first one of the other."""

    first: str
    second: str
    once: bool = False

    def __str__(self) -> str:
        return f"{self.first} before {'the first ' if self.once else ''}{self.second}"


def order_of(name: str) -> Order | None:
    """Return the order that a name stands for; None if it is the name of a field."""
    found = _ORDER.fullmatch(name)
    return Order(found["first"], found["second"], found["once"] is not None) if found else None
