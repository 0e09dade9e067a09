"""A box in one or more fields, fitted to samples that failed or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

Place = tuple[float, ...]
"""Value of each field."""


class RegionSample(NamedTuple):
    """A point, and whether it failed."""

    place: Place
    failed: bool


@dataclass(frozen=True, slots=True)
class Box:
    """Ranges of fields, edges included.

    Attributes:
        edges: Smallest and largest value of the first field, then of the second, and so on: side 2 i is the lower one
            of field i, side 2 i + 1 the upper one.
    """

    edges: tuple[float, ...]

    @property
    def ranges(self) -> tuple[tuple[float, float], ...]:
        """Smallest and largest value of each field."""
        return tuple(zip(self.edges[::2], self.edges[1::2], strict=True))

    @property
    def spans(self) -> Place:
        """Width along each field."""
        return tuple(high - low for low, high in self.ranges)

    def contains(self, place: Place, *, but: int | None = None) -> bool:
        """Return whether a point is inside, without regard to the field `but`."""
        return all(
            low <= value <= high
            for axis, (value, (low, high)) in enumerate(zip(place, self.ranges, strict=True))
            if axis != but
        )

    def clearance(self, place: Place, widths: Sequence[float]) -> float:
        """Return how far a point is from the nearest edge that matters, in units of `widths`."""
        outside = (
            max(low - value, value - high) / width
            for value, (low, high), width in zip(place, self.ranges, widths, strict=True)
        )
        return abs(max(outside))


def fit_box(samples: Sequence[RegionSample], box: Box) -> Box:
    """Return the box near a given one that contradicts the fewest samples.

    Edges are moved in turn; among equally good places the middle of the interval nearest to the old edge is taken.
    """
    for _ in range(4):  # a guess: it ends earlier if no edge moves, but that is not certain
        before = box
        for side in range(len(box.edges)):
            edges = list(box.edges)
            edges[side] = _best_edge(samples, box, side)
            box = Box(tuple(edges))
        if box == before:
            break
    return box


def _best_edge(samples: Sequence[RegionSample], box: Box, side: int) -> float:
    axis, upper = divmod(side, 2)
    other = box.edges[2 * axis + 1 - upper]
    relevant = [
        (place[axis], failed)
        for place, failed in samples
        if box.contains(place, but=axis) and (place[axis] > other if upper else place[axis] < other)
    ]
    return _threshold(relevant, box.edges[side], upper=bool(upper))


def _threshold(relevant: Sequence[tuple[float, bool]], old: float, *, upper: bool) -> float:
    """Return the edge between failing values (towards the box) and passing ones that contradicts the fewest."""
    sign = 1.0 if upper else -1.0
    ordered = sorted((sign * value, failed) for value, failed in relevant)
    if not ordered:
        return old
    wrong = sum(failed for _, failed in ordered)
    places = []
    for at, (value, failed) in enumerate(ordered):
        wrong += -1 if failed else 1
        # Beyond the last sample there is no evidence for more.
        following = ordered[at + 1][0] if at + 1 < len(ordered) else value
        if following > value or at + 1 == len(ordered):
            edge = (value + following) / 2
            places.append((wrong, abs(sign * edge - old), sign * edge))
    return min(places)[2]
