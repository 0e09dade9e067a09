"""Sequence numbers of frames that somebody else than their source has made."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus_mavlink.frame import seal
from riot_bus_mavlink.signing import link_of, time_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus_mavlink.frame import Frame
    from riot_bus_mavlink.signing import Signer

__all__ = ["OwnStreams"]

_MOST_SOURCES = 4096


class OwnStreams:
    """Numbers inserted frames on streams of their own, one by system and component, that begin with 0.

    The numbers of a source go from end to end, so that receivers tell losses by them; inserted frames must not use them
    up, and those of the source are never changed. A receiver that keeps one count by source sees a gap all the same.

    Args:
        crc_extra: Returns a message's extra byte of the checksum, None if the message is unknown.
        signer: Signs signed frames anew; None if the key is not known.

    Attributes:
        crc_extra: Returns a message's extra byte of the checksum.
    """

    def __init__(self, crc_extra: Callable[[int], int | None], signer: Signer | None = None) -> None:
        self.crc_extra, self._signer = crc_extra, signer
        self._next: dict[int, int] = {}

    def next(self, system: int, component: int) -> int:
        """Return the number of the next inserted frame of a source."""
        source = system << 8 | component
        if source not in self._next and len(self._next) >= _MOST_SOURCES:
            return 0
        number = self._next.get(source, 0)
        self._next[source] = (number + 1) & 255
        return number

    def renumber(self, frame: Frame) -> bytes:
        """Return a frame with the next number of its source's own stream.

        Those of unknown messages stay as they are, since no checksum can be made for them; so do signed ones without
        the key, or with a signature that is not of this key.
        """
        extra = self.crc_extra(frame.message_id)
        if extra is None or (frame.signed and (self._signer is None or not self._signer.fits(frame))):
            return frame.raw
        first = frame.version == 1
        head = bytearray(frame.raw[: 6 if first else 10])
        head[2 if first else 4] = self.next(frame.system, frame.component)
        raw = seal(bytes(head), frame.payload, extra)
        if not frame.signed or self._signer is None:
            return raw
        return self._signer.sign(raw, link_of(frame), time_of(frame))
