"""A box in two fields, fitted to samples that failed or not."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["Box", "Sample", "fit_box"]

Sample = tuple[float, float, bool]
"""Value of the first field, of the second, and whether the run failed."""

_SWEEPS = 4


class Box(NamedTuple):
    """Ranges of two fields, edges included."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    @property
    def spans(self) -> tuple[float, float]:
        """Width and height."""
        return self.x_max - self.x_min, self.y_max - self.y_min

    def contains(self, x: float, y: float) -> bool:
        """Return whether a point is inside."""
        return self.x_min <= x <= self.x_max and self.y_min <= y <= self.y_max

    def clearance(self, x: float, y: float, widths: Sequence[float]) -> float:
        """Return how far a point is from the nearest edge that matters, in units of `widths`."""
        outside = max(
            (self.x_min - x) / widths[0], (x - self.x_max) / widths[0],
            (self.y_min - y) / widths[1], (y - self.y_max) / widths[1],
        )  # fmt: skip
        return abs(outside)


def fit_box(samples: Sequence[Sample], box: Box) -> Box:
    """Return the box near a given one that contradicts the fewest samples.

    Edges are moved in turn; among equally good places the middle of the interval nearest to the old edge is taken.

    Args:
        samples: What is known.
        box: Where to begin.
    """
    edges = list(box)
    for _ in range(_SWEEPS):
        before = list(edges)
        for side in range(4):
            edges[side] = _best_edge(samples, edges, side)
        if edges == before:
            break
    return Box(*edges)


def _best_edge(samples: Sequence[Sample], edges: Sequence[float], side: int) -> float:
    axis, upper = divmod(side, 2)
    across = edges[2:] if axis == 0 else edges[:2]
    other = edges[2 * axis + 1 - upper]
    relevant = [
        (sample[axis], sample[2])
        for sample in samples
        if across[0] <= sample[1 - axis] <= across[1] and (sample[axis] > other if upper else sample[axis] < other)
    ]
    return _threshold(relevant, edges[side], upper=bool(upper))


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
        # Beyond the last sample nothing speaks for more.
        following = ordered[at + 1][0] if at + 1 < len(ordered) else value
        if following > value or at + 1 == len(ordered):
            edge = (value + following) / 2
            places.append((wrong, abs(sign * edge - old), sign * edge))
    return min(places)[2]
