"""The other end of a link, and what links need of who opens them."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Protocol

from riot_bus_mavlink.bridge.losses import Losses
from riot_bus_mavlink.bridge.routing import Peer
from riot_bus_mavlink.bridge.url import Direction, LinkKind

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus_mavlink.bridge.url import LinkSpec
    from riot_bus_mavlink.frame import Framer
    from riot_bus_mavlink.links.loop import Loop

__all__ = ["End", "Host", "Link"]


class End(Peer):
    """One that sends frames and gets frames over a link.

    Args:
        spec: The link.
        address: Where it is, for status.
        framer: Finds frames in what it sends.
        write: Sends bytes; returns whether they went out, or will.

    Attributes:
        segment: Name of the segment that the link belongs to.
        out: Frames that were given to it.
        lost: Frames that it had no room for.
    """

    __slots__ = ("_lock", "_write", "address", "framer", "losses", "lost", "out", "segment")

    def __init__(self, spec: LinkSpec, address: str, framer: Framer, write: Callable[[bytes], bool]) -> None:
        super().__init__(
            spec.name,
            group=spec.group,
            accepts=spec.accepts,
            emits=spec.emits,
            receives=spec.direction is not Direction.SENDER,
            sends=spec.direction is not Direction.RECEIVER,
            hears_all=spec.kind is LinkKind.LOG_WRITER,
        )
        self.segment = spec.segment
        self.address, self.framer = address, framer
        self.losses = Losses()
        self.out = self.lost = 0
        self._write = write
        self._lock = threading.Lock()

    def send(self, raw: bytes) -> None:
        """Send a frame, or count it as lost; on any thread, without waiting."""
        with self._lock:
            if self._write(raw):
                self.out += 1
            else:
                self.lost += 1


class Host(Protocol):
    """Who opens links."""

    loop: Loop
    crc_extra: Callable[[int], int | None]

    def join(self, spec: LinkSpec, address: str, write: Callable[[bytes], bool]) -> End:
        """Take in a new end of a link, from now on it gets frames."""

    def leave(self, end: End) -> None:
        """Forget an end that is gone."""

    def take(self, end: End, data: bytes) -> None:
        """Take bytes that came."""

    def warn(self, spec: LinkSpec, text: str) -> None:
        """Say what does not work."""


class Link(Protocol):
    """A link that is open."""

    spec: LinkSpec

    @property
    def where(self) -> str:
        """Where it really is, such as the port that it got."""

    @property
    def state(self) -> str:
        """Return how it is: `listening`, `connected`, `connecting`, `reading`, `ended`."""

    def dropped(self) -> int:
        """Return the packets that the operating system has dropped because they were not taken in time."""

    def close(self) -> None:
        """Close it."""
