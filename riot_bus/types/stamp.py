"""What a middleware says of each message and each publisher, for those who record: what adapters add to `Adapter`."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from riot_bus.types.model import Schema

__all__ = ["Stamp", "Stamping"]


class Stamp(NamedTuple):
    """What a message says of itself.

    Attributes:
        sequence: Its number at its publisher; the next one's is one more.
        time: When it was published, nanoseconds since the Unix epoch.
        publisher: Who that was.
    """

    sequence: int
    time: int
    publisher: bytes


@runtime_checkable
class Stamping(Protocol):
    """What an adapter can do besides `Adapter`, if its middleware numbers messages and announces publishers.

    Attributes:
        tokens: Key expression of the liveliness tokens that announce publishers.
    """

    tokens: str

    def stamp(self, attachment: bytes) -> Stamp | None:
        """Return what an attachment says, None if it is of another kind."""
        ...

    def details(self, key: str, tokens: Iterable[str]) -> Mapping[str, str]:
        """Return metadata for the key's channel in a log, such as the offered quality of service.

        Args:
            key: Of this adapter's kind.
            tokens: Keys of all present tokens.
        """
        ...

    def definition(self, key: str) -> tuple[Schema, str] | None:
        """Return schema and encoding of a log's channel for a key whose type is not known here; None if there is none.

        Args:
            key: Of this adapter's kind.
        """
        ...
