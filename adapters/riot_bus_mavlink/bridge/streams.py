"""Sequence numbers of frames that somebody else than their source has made."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus_mavlink.frame import V1, seal

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus_mavlink.frame import Frame

__all__ = ["OwnStreams"]

_MOST_SOURCES = 4096


class OwnStreams:
    """Numbers inserted frames on streams of their own, one by system and component, that begin with 0.

    The numbers of a source go from end to end, so that receivers tell losses by them; inserted frames must not use them
    up, and those of the source are never changed. A receiver that keeps one count by source sees a gap all the same.

    Args:
        crc_extra: Returns a message's extra byte of the checksum, None if the message is unknown.
    """

    def __init__(self, crc_extra: Callable[[int], int | None]) -> None:
        self._extra = crc_extra
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

        Signed frames and those of unknown messages stay as they are: no signature or checksum can be made for them.
        """
        extra = self._extra(frame.message_id)
        if frame.signed or extra is None:
            return frame.raw
        raw = bytearray(frame.raw[:-2])
        place = 2 if raw[0] == V1 else 4
        raw[place] = self.next(frame.system, frame.component)
        start = 6 if raw[0] == V1 else 10
        return seal(bytes(raw[:start]), bytes(raw[start:]), extra)
