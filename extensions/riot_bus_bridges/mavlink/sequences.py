"""Sequence numbers: gaps in those of each source, which tell what was lost, and those of inserted frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from riot_bus_mavlink.frame import HEADER_SIZE, Frame, seal
from riot_bus_mavlink.signing import Signer, link_of, time_of

MOST_IDS = 4096
"""Of what senders may make up (65,536 sources, 24-bit ids of messages): bounds memory and publishers; a guess."""


@dataclass(slots=True)
class SourceCount:
    """Counts of the frames of a source.

    Attributes:
        lost: Number of missing frames, as ground stations count them: the gaps in the sequence numbers. A frame that
            comes late or twice counts as a gap of nearly 256.
    """

    received: int = 0
    lost: int = 0
    last: int = -1

    def see(self, sequence: int) -> int:
        """Count a frame by its sequence number; return how many frames are missing before it."""
        missing = (sequence - self.last - 1) & 255 if self.received else 0
        self.received += 1
        self.lost += missing
        self.last = sequence
        return missing


class LinkLosses:
    """Counts by source, on one link."""

    def __init__(self) -> None:
        self._sources: dict[int, SourceCount] = {}

    def see(self, system: int, component: int, sequence: int) -> int:
        """Count a frame by its sequence number; return how many frames are missing before it."""
        count = self.of(system, component)
        return 0 if count is None else count.see(sequence)

    def of(self, system: int, component: int) -> SourceCount | None:
        """Return the counter of a source, None if there are too many sources."""
        source = system << 8 | component
        count = self._sources.get(source)
        if count is None and len(self._sources) < MOST_IDS:
            count = self._sources[source] = SourceCount()
        return count

    def counts(self) -> dict[tuple[int, int], SourceCount]:
        """Return the counts by system and component."""
        return {(source >> 8, source & 255): count for source, count in sorted(self._sources.copy().items())}


class OwnStreams:
    """Assigns sequence numbers to inserted frames, counted for each system and component from 0, modulo 256.

    A frame is inserted if it came over no link and was not played from a bridge's log, such as one that a program
    publishes on the bus. Frames from links keep their numbers, by which receivers detect losses; inserted frames must
    not use these up. A receiver that keeps only one count for each source still reports a gap at inserted frames.
    """

    def __init__(self, crc_extra: Callable[[int], int | None], signer: Signer | None = None) -> None:
        self.crc_extra, self._signer = crc_extra, signer
        self._next: dict[int, int] = {}

    def next(self, system: int, component: int) -> int:
        """Return the number of the next inserted frame of a source."""
        source = system << 8 | component
        if source not in self._next and len(self._next) >= MOST_IDS:
            return 0
        number = self._next.get(source, 0)
        self._next[source] = (number + 1) & 255
        return number

    def renumber(self, frame: Frame) -> bytes:
        """Return a frame with the next number of the stream for its source's inserted frames.

        Frames of unknown messages stay as they are, since their checksum cannot be computed; so do signed frames if
        there is no key or their signature was not made with it.
        """
        extra = self.crc_extra(frame.message_id)
        if extra is None or (frame.signed and (self._signer is None or not self._signer.made(frame.raw))):
            return frame.raw
        head = bytearray(frame.raw[: HEADER_SIZE[frame.version]])
        head[2 if frame.version == 1 else 4] = self.next(frame.system, frame.component)
        raw = seal(bytes(head), frame.payload, extra)
        if not frame.signed or self._signer is None:
            return raw
        return self._signer.sign(raw, link_of(frame), time_of(frame))
