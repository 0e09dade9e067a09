"""Sequence numbers of inserted frames, which their source did not make."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus_bridges.mavlink.losses import MOST_IDS
from riot_bus_mavlink.frame import HEADER_SIZE, seal
from riot_bus_mavlink.signing import link_of, time_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus_mavlink.frame import Frame
    from riot_bus_mavlink.signing import Signer


class OwnStreams:
    """Assigns sequence numbers to inserted frames, counted for each system and component from 0, modulo 256.

    A frame is inserted if it came over no link and was not played from a bridge's log, such as one that a program
    publishes on the bus. Frames from links keep their numbers, by which receivers detect losses; inserted frames must
    not use these up. A receiver that keeps only one count for each source still reports a gap at inserted frames.

    Args:
        crc_extra: Returns a message's CRC extra byte, None if the message is unknown.
        signer: Re-signs signed frames; None if the key is not known.
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
