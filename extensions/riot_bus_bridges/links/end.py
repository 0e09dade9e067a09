"""The other end of a link: what it gets, what it has sent, and the known routes of its frames."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from threading import get_ident
from typing import TYPE_CHECKING, NamedTuple

from riot_bus_bridges.mavlink.routing import Peer
from riot_bus_bridges.mavlink.sequences import LinkLosses
from riot_bus_bridges.mavlink.url import Direction, LinkKind

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.types.port import PortPublisher
    from riot_bus_bridges.links.loop import Loop
    from riot_bus_bridges.mavlink.sequences import SourceCount
    from riot_bus_bridges.mavlink.url import LinkSpec
    from riot_bus_mavlink.frame import Framer

MOST_PENDING = 64
"""Frames that are sent with one call: Linux's UDP_MAX_SEGMENTS, in newer versions 128; it refuses more over UDP."""


@dataclass(frozen=True, slots=True)
class Flow:
    """Frames of one message, component and end of a link, which all take the same route while the table stays.

    Attributes:
        others: Other ends on the same segment that get the frames.
    """

    extra: bytes
    count: SourceCount
    others: Sequence[End]
    outlet: PortPublisher


class Batching(NamedTuple):
    """Writes several frames at once."""

    loop: Loop
    write: Callable[[Sequence[bytes]], int]


class End(Peer):
    """Peer of a link: sends frames to it, and keeps counts and known routes of the frames that it sends to riot.

    Attributes:
        flows: Known routes of frames received from the peer, by the header bytes that identify their kind; valid while
            `generation` is that of the routing table.
        losses: Numbers of frames received from the peer, and of those missing before them, by source.
    """

    __slots__ = (
        "_batching",
        "_lock",
        "_pending",
        "_write",
        "address",
        "flows",
        "framer",
        "generation",
        "losses",
        "lost",
        "out",
        "segment",
    )

    def __init__(
        self,
        spec: LinkSpec,
        address: str,
        framer: Framer,
        write: Callable[[bytes], bool],
        batching: Batching | None = None,
    ) -> None:
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
        self.losses = LinkLosses()
        self.out = self.lost = 0
        self.flows: dict[bytes, Flow] = {}
        self.generation = -1
        self._write, self._batching = write, batching
        self._pending: list[bytes] = []  # never replaced, so that threads can append without a lock
        self._lock = threading.Lock()

    def send(self, raw: bytes) -> None:
        """Send a frame to the peer, or count it as lost, without waiting for room; callable on any thread."""
        batching = self._batching
        if batching is not None and batching.loop.ident == get_ident():
            pending = self._pending
            if not pending:
                batching.loop.at_end(self.flush)
            pending.append(raw)
            if len(pending) >= MOST_PENDING:
                self.flush()
            return
        with self._lock:
            if self._pending:  # they came first
                self._send_pending()
            if self._write(raw):
                self.out += 1
            else:
                self.lost += 1

    def send_all(self, raws: Sequence[bytes]) -> None:
        """Send frames in their order, as `send` does."""
        batching = self._batching
        if batching is None or batching.loop.ident != get_ident():
            for raw in raws:
                self.send(raw)
            return
        if not self._pending:
            batching.loop.at_end(self.flush)
        self._pending += raws
        if len(self._pending) >= MOST_PENDING:
            self.flush()

    def flush(self) -> None:
        """Send the frames that wait for the end of a handler; callable on any thread."""
        with self._lock:
            self._send_pending()

    def _send_pending(self) -> None:
        frames = self._pending[:]
        del self._pending[: len(frames)]
        if frames and self._batching is not None:
            done = self._batching.write(frames)
            self.out += done
            self.lost += len(frames) - done
