"""What a definition says of the values that are worth trying in a field, and of fields that are better left alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.types.model import MessageType
    from riot_bus.vocabulary.trial import Scalar

__all__ = ["ExceptionalValue", "Exceptions", "Guarded", "entries_of"]


@dataclass(frozen=True, slots=True)
class ExceptionalValue:
    """One exceptional value, and why it is worth trying."""

    value: Scalar
    reason: str


@runtime_checkable
class Exceptions(Protocol):
    """What a `MessageType` can offer besides its protocol, if definitions tell more of values than their type does."""

    def exceptional(self, payload: bytes, path: str) -> Sequence[ExceptionalValue]:
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


def entries_of(kind: MessageType | None, payload: bytes, path: str) -> Sequence[ExceptionalValue]:
    """Return the values that a field's definition tells, none if its type tells nothing."""
    return kind.exceptional(payload, path) if isinstance(kind, Exceptions) else ()
