"""What a bridge needs of a segment; `riot_bus.bus.bridge` has it. Methods are described there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

__all__ = ["Closeable", "Outlet", "Port"]


class Closeable(Protocol):
    """Something that was declared."""

    def close(self) -> None:
        """Take it away."""


class Outlet(Closeable, Protocol):
    """A publisher."""

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publish."""

    def matched(self) -> bool:
        """Return whether somebody elsewhere subscribes."""


class Port(Protocol):
    """A segment."""

    @property
    def endpoint(self) -> str:
        """Where it is connected."""

    def publisher(
        self, key: str, *, reliable: bool, changed: Callable[[], None] | None = None, encoding: str = ""
    ) -> Outlet:
        """Return a new publisher."""

    def put_all(self, outlets: Sequence[Outlet], payloads: Sequence[bytes], attachment: bytes) -> int:
        """Publish many messages, each with one of this port's publishers; return how many could not be published."""

    def subscribe(self, key: str, take: Callable[[bytes, bytes | None], None]) -> Closeable:
        """Subscribe to what others put."""

    def collect(self, expression: str, take: Callable[[list[tuple[bytes, bytes | None]]], None]) -> Closeable:
        """Subscribe to what others put, several messages at once."""
