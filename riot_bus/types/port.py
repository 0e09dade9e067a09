"""What a bridge of an adapter needs of a segment, so that it needs no Zenoh; `riot_bus.bridge` implements it.

Methods are described there. `BridgePort` is what a bridge has that is its own router; `SegmentAccess` is what one has
that connects to a segment of a router elsewhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

__all__ = ["BridgePort", "Closeable", "PortPublisher", "PortQuery", "SegmentAccess"]


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
    """A segment to publish on and to subscribe to."""

    @property
    def endpoint(self) -> str:
        """Where it is connected, to be shown: without what stands behind `#`."""

    def publisher(
        self, key: str, *, reliable: bool, changed: Callable[[], None] | None = None, encoding: str = ""
    ) -> PortPublisher:
        """Return a new publisher."""

    def put_all(self, outlets: Sequence[PortPublisher], payloads: Sequence[bytes], attachment: bytes) -> int:
        """Publish many messages, each with one of this port's publishers; return how many could not be published."""

    def subscribe(self, key: str, take: Callable[[bytes, bytes | None], None]) -> Closeable:
        """Subscribe to what others put."""

    def collect(self, expression: str, take: Callable[[list[tuple[bytes, bytes | None]]], None]) -> Closeable:
        """Subscribe to what others put, several messages at once."""


class SegmentAccess(Protocol):
    """A segment with all that ROS 2 nodes do there: latched topics, tokens, services."""

    @property
    def zid(self) -> str:
        """Id of the Zenoh session."""

    @property
    def endpoint(self) -> str:
        """Where it is connected, to be shown: without what stands behind `#`."""

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
