"""Counts of what crossed a link, over all ends that it had."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from riot_bus_bridges.mavlink.losses import MOST_IDS

if TYPE_CHECKING:
    from riot_bus_bridges.links.end import End
    from riot_bus_bridges.links.link import Link
    from riot_bus_bridges.mavlink.url import LinkSpec

_STREAM = ("frames", "unknown", "bad_crc", "bytes", "frame_bytes", "junk_bytes")


class LinkTally:
    """Counts of one link."""

    def __init__(self, spec: LinkSpec) -> None:
        self.spec = spec
        self._ends: list[End] = []
        self._ended: dict[str, Any] | None = None
        self._past: Counter[str] = Counter()
        self._past_sources: dict[tuple[int, int], Counter[str]] = {}

    def join(self, end: End) -> None:
        """Include an end in the counts."""
        self._ends = [*self._ends, end]

    def leave(self, end: End) -> None:
        """Keep the counts of an end that is gone."""
        end.framer.flush()
        self._past += _counts_of(end)
        _add_sources(self._past_sources, end)
        self._ends = [each for each in self._ends if each is not end]

    def end(self, link: Link) -> None:
        """Keep the state of a link that is about to be closed."""
        self._ended = _state_of(link)

    def addresses(self) -> tuple[str, ...]:
        """Return the addresses of the present ends."""
        return tuple(end.address for end in self._ends)

    def status(self, link: Link) -> dict[str, Any]:
        """Return the state and the counts as JSON values."""
        total = Counter(self._past)
        sources = {source: Counter(counts) for source, counts in self._past_sources.items()}
        for end in self._ends:
            total += _counts_of(end)
            _add_sources(sources, end)
        return {
            "kind": str(self.spec.kind),
            "segment": self.spec.segment,
            **(self._ended or _state_of(link)),
            **dict(sorted(total.items())),
            "ends": [
                {"address": end.address, "sources": [f"{system}/{part}" for system, part in sorted(end.sources)]}
                for end in self._ends
            ],
            "sources": {f"{system}/{part}": dict(counts) for (system, part), counts in sorted(sources.items())},
        }


def _state_of(link: Link) -> dict[str, Any]:
    return {"where": link.where, "state": link.state, "dropped_packets": link.dropped()}


def _counts_of(end: End) -> Counter[str]:
    found = Counter(end.counts)
    found.update({name: getattr(end.framer.counts, name) for name in _STREAM})
    found.update({"out": end.out, "lost_out": end.lost})
    return +found


def _add_sources(sources: dict[tuple[int, int], Counter[str]], end: End) -> None:
    for source, count in end.losses.counts().items():
        if source in sources or len(sources) < MOST_IDS:
            sources.setdefault(source, Counter()).update(received=count.received, lost=count.lost)
