"""What a definition says of the values that are worth trying in a field, and of fields that are better left alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.trial import Scalar

__all__ = ["Exceptional", "Exceptions", "Guarded"]


@dataclass(frozen=True, slots=True)
class Exceptional:
    """A value worth trying, and why."""

    value: Scalar
    reason: str


@runtime_checkable
class Exceptions(Protocol):
    """What a `MessageType` can offer besides its protocol, if definitions tell more of values than their type does."""

    def exceptional(self, payload: bytes, path: str) -> Sequence[Exceptional]:
        """Return values of a field that are worth trying: unusual, at limits, beyond limits, undefined.

        Args:
            payload: A sample; what a field means may depend on others.
            path: A field of it.

        Returns:
            Values that the field can hold, none if nothing tells or there is no such field.
        """
        ...


@runtime_checkable
class Guarded(Protocol):
    """What a `MessageType` can offer besides its protocol, if it knows what makes receivers refuse a message."""

    def brittle(self, path: str) -> str | None:
        """Return why a field should be left alone unless it was asked for.

        Returns:
            The reason, empty if it may be changed, None if nothing tells; then its name decides.
        """
        ...
