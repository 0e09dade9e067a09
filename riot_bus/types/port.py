"""Access of an adapter to a segment, independent of Zenoh; implemented by `riot_bus.zenoh.segment_port`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

Take = Callable[[list[tuple[bytes, bytes | None]]], None]
"""Function that takes payloads with their attachments, in order."""


@dataclass(frozen=True, slots=True)
class BridgedLink:
    """A link of a bridge in the router's own process; to the bus, it represents the systems at its other end.

    Attributes:
        addresses: Addresses of its other ends.
        publishes: Systems behind the link that published over it, by key.
        subscribes: Key expression of messages that can be sent over it; empty if none can.
    """

    segment: str
    name: str
    addresses: tuple[str, ...] = ()
    publishes: Mapping[str, str] = field(default_factory=dict)
    subscribes: str = ""


class Closeable(Protocol):
    """A declared entity, such as a subscriber or a token."""

    def close(self) -> None:
        """Undeclare it."""


class PortPublisher(Closeable, Protocol):
    """A publisher."""

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publish a message."""

    def matched(self) -> bool:
        """Return whether there is a remote subscriber."""


class SegmentAccess(Protocol):
    """A segment of a router."""

    @property
    def zid(self) -> str:
        """Id of the Zenoh session."""

    @property
    def endpoint(self) -> str:
        """Endpoint for display, without the part after `#`."""

    def publisher(self, key: str, *, reliable: bool, changed: Callable[[], None] = lambda: None) -> PortPublisher:
        """Return a new publisher."""

    def subscribe(self, key: str, take: Callable[[bytes, bytes | None], None]) -> Closeable:
        """Subscribe to messages of others."""

    def watch(self, expression: str, take: Callable[[str, bool], None]) -> Closeable:
        """Subscribe to liveliness tokens."""

    def ask(
        self,
        key: str,
        payload: bytes,
        attachment: bytes,
        done: Callable[[bytes | None], None],
        *,
        complete: bool = True,
    ) -> Closeable:
        """Send a request to the servers of a key; closing the result cancels it."""
