"""What a bridge needs of a segment; `riot_bus.bridge` has it. Methods are described there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["BridgePort", "Closeable", "PortPublisher", "PortQuery"]


class Closeable(Protocol):
    """Something that was declared."""

    def close(self) -> None:
        """Take it away."""


class PortPublisher(Closeable, Protocol):
    """A publisher."""

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publish."""

    def matched(self) -> bool:
        """Return whether somebody elsewhere subscribes."""


class PortQuery(Protocol):
    """A request that waits for its response."""

    @property
    def payload(self) -> bytes:
        """What is asked."""

    @property
    def attachment(self) -> bytes | None:
        """What was sent with it."""

    def answer(self, payload: bytes, attachment: bytes | None) -> None:
        """Answer."""

    def fail(self, reason: str) -> None:
        """Answer that there is no answer."""


class BridgePort(Protocol):
    """A segment."""

    @property
    def zid(self) -> str:
        """Id of the Zenoh session."""

    @property
    def endpoint(self) -> str:
        """Where it is connected."""

    def publisher(
        self, key: str, *, reliable: bool, latched: int | None = None, changed: Callable[[], None] = lambda: None
    ) -> PortPublisher:
        """Return a new publisher."""

    def subscribe(
        self, key: str, take: Callable[[bytes, bytes | None], None], *, latched: int | None = None
    ) -> Closeable:
        """Subscribe to what others put."""

    def announce(self, token: str) -> Closeable:
        """Show a liveliness token."""

    def watch(self, expression: str, take: Callable[[str, bool], None]) -> Closeable:
        """Follow liveliness tokens."""

    def serve(self, key: str, take: Callable[[PortQuery], None]) -> Closeable:
        """Answer the questions of others."""

    def ask(self, key: str, payload: bytes, attachment: bytes, done: Callable[[bytes | None], None]) -> Closeable:
        """Ask the servers of a key; return what gives up."""
