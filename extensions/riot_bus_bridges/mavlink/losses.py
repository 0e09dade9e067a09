"""Frames lost before they reached the bridge: gaps in the sequence numbers of each source."""

from __future__ import annotations

from dataclasses import dataclass

MOST_IDS = 4096
"""Of what senders may make up (65,536 sources, 24-bit ids of messages): bounds memory and publishers; a guess."""


@dataclass(slots=True)
class SourceCount:
    """Counts of the frames of a source.

    Attributes:
        received: Number of received frames.
        lost: Number of missing frames, as ground stations count them: the gaps in the sequence numbers. A frame that
            comes late or twice counts as a gap of nearly 256.
        last: The last sequence number.
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
