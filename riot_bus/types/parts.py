"""The messages that a message is made of, so that what is known of a part is used wherever it stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["MOST_PARTS", "Composed", "Part"]

MOST_PARTS = 1_000
"""So many are listed of one type."""


@dataclass(frozen=True, slots=True)
class Part:
    """A message within others.

    Attributes:
        path: Such as `pose.pose`, or `poses[*].header` for those in each element of an array; empty for the whole.
        type_name: Its type.
    """

    path: str
    type_name: str


@runtime_checkable
class Composed(Protocol):
    """What a `MessageType` can offer besides its protocol, if its messages are made of messages."""

    def parts(self) -> Sequence[Part]:
        """List the whole and all messages in it, outer ones first, `MOST_PARTS` at most.

        Raises:
            PayloadError: The type has parts that are not known.
        """
        ...
