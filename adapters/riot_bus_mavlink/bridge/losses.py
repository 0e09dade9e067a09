"""What was lost before it came here: gaps in the sequence numbers of each source."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Losses", "SourceCount"]

_MOST_SOURCES = 4096


@dataclass(slots=True)
class SourceCount:
    """What is known of a source.

    Attributes:
        received: Frames.
        lost: Frames that are missing, as ground stations count them: the gaps in the sequence numbers. A frame that
            comes late or twice counts as a gap of nearly 256.
        last: The last sequence number.
    """

    received: int = 0
    lost: int = 0
    last: int = -1


class Losses:
    """Counts by source, on one link."""

    def __init__(self) -> None:
        self._sources: dict[int, SourceCount] = {}

    def see(self, system: int, component: int, sequence: int) -> int:
        """Take in the number of a frame; return how many frames are missing before it."""
        source = system << 8 | component
        count = self._sources.get(source)
        if count is None:
            if len(self._sources) >= _MOST_SOURCES:
                return 0
            count = self._sources[source] = SourceCount()
        missing = (sequence - count.last - 1) & 255 if count.received else 0
        count.received += 1
        count.lost += missing
        count.last = sequence
        return missing

    def counts(self) -> dict[tuple[int, int], SourceCount]:
        """Return what is known, by system and component."""
        return {(source >> 8, source & 255): count for source, count in sorted(self._sources.copy().items())}
