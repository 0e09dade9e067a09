"""Access of a bridge to a segment, independent of Zenoh.

Methods are described where they are implemented: `BridgePort`, for a bridge in one process with its router, in
`host.inner`, `OuterAccess`, for a bridge that connects to a segment of another router, in `host.outer_port`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from riot_bus.types.port import Closeable, PortPublisher, SegmentAccess


class PortQuery(Protocol):
    """A request that waits for its response."""

    @property
    def payload(self) -> bytes:
        """Payload of the request."""

    @property
    def attachment(self) -> bytes | None:
        """Attachment of the request."""

    def answer(self, payload: bytes, attachment: bytes | None) -> None:
        """Send the response."""

    def fail(self, reason: str) -> None:
        """Reply with an error."""


class BridgePort(Protocol):
    """A segment in which to publish and subscribe."""

    @property
    def endpoint(self) -> str:
        """Endpoint for display, without the part after `#`."""

    def publisher(
        self, key: str, *, reliable: bool, changed: Callable[[], None] | None = None, encoding: str = ""
    ) -> PortPublisher:
        """Return a new publisher."""

    def put_all(self, outlets: Sequence[PortPublisher], payloads: Sequence[bytes], attachment: bytes) -> int:
        """Publish many messages, each with one of this port's publishers; return how many could not be published."""

    def subscribe(self, key: str, take: Callable[[bytes, bytes | None], None]) -> Closeable:
        """Subscribe to messages of others."""

    def collect(self, expression: str, take: Callable[[list[tuple[bytes, bytes | None]]], None]) -> Closeable:
        """Subscribe to messages of others, taking several at once."""


class OuterAccess(SegmentAccess, Protocol):
    """A segment with everything that ROS 2 nodes use: latched topics, tokens, services."""

    def publisher(
        self, key: str, *, reliable: bool, changed: Callable[[], None] = lambda: None, latched: int | None = None
    ) -> PortPublisher:
        """Return a new publisher."""

    def subscribe(
        self, key: str, take: Callable[[bytes, bytes | None], None], *, latched: int | None = None
    ) -> Closeable:
        """Subscribe to messages of others."""

    def announce(self, token: str) -> Closeable:
        """Declare a liveliness token."""

    def serve(self, key: str, take: Callable[[PortQuery], None]) -> Closeable:
        """Answer the requests of others."""
