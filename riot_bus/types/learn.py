"""Types that nothing here defines, but that participants of the bus describe to those who ask: what adapters add."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from riot_bus.types.model import MessageType

__all__ = ["Ask", "Learning"]

Ask = Callable[[str, bytes, bytes], Iterable[bytes]]
"""Returns the payloads of the replies to a query, from its key, payload and attachment; in bounded time."""


@runtime_checkable
class Learning(Protocol):
    """What an adapter can do besides `Adapter`, if participants of its middleware describe types.

    Both may take long, so nobody who handles messages calls them.
    """

    def missing(self, key: str) -> bool:
        """Return whether a key names a type whose definition is not known here, and for which one can ask."""
        ...

    def learn(self, key: str, tokens: Iterable[str], heard: Sequence[bytes], ask: Ask) -> MessageType | None:
        """Ask those who use a key for its type, and remember it; None if nobody knows, or nobody can be asked now.

        Args:
            key: One that is missing.
            tokens: Keys of all present liveliness tokens.
            heard: Attachments of some messages of the key, which may tell who takes which questions.
            ask: Puts a question.
        """
        ...
