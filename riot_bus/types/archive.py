"""Files of messages in formats of other tools, one record after another, that an adapter knows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.vocabulary.message import Message

__all__ = ["Archiving", "Unpacker"]


class Unpacker(Protocol):
    """Takes one file apart, piece by piece; never raises on hostile bytes."""

    def feed(self, data: bytes) -> Sequence[Message]:
        """Return the messages that are complete with these bytes, under the keys that they have on the bus."""
        ...

    def end(self) -> Sequence[Message]:
        """Return what is left when the file has ended."""
        ...

    def loss(self) -> str:
        """Return what could not be read so far, empty if nothing."""
        ...


@runtime_checkable
class Archiving(Protocol):
    """What an adapter can do besides `Adapter`, if there are files of its messages in a format of their own.

    Attributes:
        archives: Endings of such files.
    """

    archives: Sequence[str]

    def unpacker(self) -> Unpacker:
        """Return what takes one file apart."""
        ...

    def packed(self, message: Message) -> bytes | None:
        """Return the record of a message, None if it is of another kind."""
        ...
