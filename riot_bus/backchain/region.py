"""The crash zone around one failing point, as a box in external fields (RIOT III, Fig. 2)."""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from riot_bus.backchain.box import Box, Place, RegionSample, fit_box
from riot_bus.backchain.encoding import SearchField
from riot_bus.vocabulary.trial import Ask, Progress

_STRIDE = 4.0
_ROUNDS = 20
FIT = 0.9
"""Share of samples with which a box has to agree, on either side of its edges."""
_CORNERS = 16
"""Most corners that are sampled: all of them for up to four fields."""


@dataclass(frozen=True, slots=True)
class Region:
    """A box in which the failure happens.

    Attributes:
        samples: The start and all tested points, in order.
        good: Whether the box describes the zone: away from its edges, nine of ten samples on either side agree.
        ends: Sides of the box with a failure at the end of the field's range, beyond which nothing was tried.
    """

    names: tuple[str, ...]
    box: Box
    samples: tuple[RegionSample, ...]
    good: bool
    ends: frozenset[int]


def map_region(
    start: Mapping[str, float],
    axes: Sequence[SearchField],
    ask: Ask[Mapping[str, float]],
    *,
    seed: int,
    budget: int = 80,
    tolerance: float | Sequence[float],
    progress: Progress | None = None,
) -> Region:
    """Find the boundary of the crash zone around a failing point.

    First, growing steps and bisection along each axis; then samples at the corners and on either side of each edge,
    which move the edges until a round of samples comes out as predicted.

    Fields other than the axes keep their values at the start. Edges are bracketed to the tolerance, in the units of the
    fields (one number, or one per axis).

    Raises:
        ValueError: `tolerance` or `budget` is not positive, there are no axes, or two are one field.
    """
    widths = [tolerance] * len(axes) if isinstance(tolerance, int | float) else tolerance
    alike = len({axis.name for axis in axes}) < len(axes)
    if not axes or alike or min(widths) <= 0 or budget < 1:
        raise ValueError(f"no region map with tolerance {tolerance}, budget {budget}")
    mapper = _Mapper(start, axes, widths, ask, budget=budget, progress=progress)
    first = Box(tuple(_shoot(mapper, [(side, mapper.start) for side in range(2 * len(axes))])))
    box = _refine(mapper, first, np.random.default_rng([seed, 41]))
    return _report(mapper, box)


class _Mapper:
    """Tests points within the budget and remembers the results."""

    def __init__(
        self,
        start: Mapping[str, float],
        axes: Sequence[SearchField],
        widths: Sequence[float],
        ask: Ask[Mapping[str, float]],
        *,
        budget: int,
        progress: Progress | None,
    ) -> None:
        self.axes = axes
        self.widths = tuple(
            max(width, 1.0) if axis.integer else width for axis, width in zip(axes, widths, strict=True)
        )
        self.start: Place = tuple(start[axis.name] for axis in axes)
        self.limits = [limit for axis in axes for limit in (axis.low, axis.high)]
        self.samples: list[RegionSample] = [RegionSample(self.start, failed=True)]
        self._fixed = dict(start)
        self._ask = ask
        self._left = budget
        self._budget = budget
        self._progress = progress

    def asked(self, places: Sequence[Place]) -> list[bool | None]:
        """Return whether each place fails; None where the budget did not suffice."""
        known: dict[Place, bool] = dict(self.samples)
        wanted = [self.sensible(place) for place in places]
        new = list(dict.fromkeys(place for place in wanted if place not in known))[: self._left]
        if new:
            names = [axis.name for axis in self.axes]
            points = [self._fixed | dict(zip(names, place, strict=True)) for place in new]
            for place, failed in zip(new, self._ask(points), strict=True):
                known[place] = failed
                self.samples.append(RegionSample(place, failed))
            self._left -= len(new)
            if self._progress is not None:
                self._progress(self._budget - self._left, self._budget, "boundary of the crash zone")
        return [known.get(place) for place in wanted]

    def sensible(self, place: Place) -> Place:
        """Return a place within the fields' ranges, sensibly rounded."""
        return tuple(axis.sensible(value) for axis, value in zip(self.axes, place, strict=True))


def _with(place: Place, axis: int, value: float) -> Place:
    return (*place[:axis], value, *place[axis + 1 :])


def _ray(start: float, end: float, width: float, nominal: float) -> Generator[float, bool | None, float]:
    """Yield values to test between a failing one and the end of the range; return where the zone ends."""
    inside, outside = start, end
    sign = math.copysign(1.0, end - start)
    stride, asked = width, False
    if min(start, end) < nominal < max(start, end):
        failed = yield nominal
        if failed is None:
            return inside
        inside, outside, asked = (nominal, end, False) if failed else (start, nominal, True)
        stride = max(width, _STRIDE * abs(inside - start))
    while not asked and abs(inside - end) > 0:
        value = start + sign * stride if stride < abs(end - start) else end
        failed = yield value
        if failed is None:
            return inside
        if not failed:
            outside = value
            break
        inside = value
        stride *= _STRIDE
    while abs(outside - inside) > width:
        # Far brackets are halved on the log scale of the distance from the start, near ones on the plain scale.
        near, far = abs(inside - start), abs(outside - start)
        middle = math.sqrt(near * far) if near > 0 and far > 2 * near else (near + far) / 2
        failed = yield start + sign * middle
        if failed is None:
            break
        if failed:
            inside = start + sign * middle
        else:
            outside = start + sign * middle
    return (inside + outside) / 2


def _shoot(mapper: _Mapper, origins: Sequence[tuple[int, Place]]) -> list[float]:
    """Return where the zone ends from each failing place towards the given side of a box."""
    rays = [
        _ray(place[side // 2], mapper.limits[side], mapper.widths[side // 2], mapper.axes[side // 2].nominal)
        for side, place in origins
    ]
    edges = [place[side // 2] for side, place in origins]
    asked: dict[int, float] = {}

    def advance(at: int, *, answer: bool | None) -> None:
        try:
            asked[at] = rays[at].send(answer)
        except StopIteration as stop:
            asked.pop(at, None)
            edges[at] = stop.value

    for at in range(len(rays)):
        advance(at, answer=None)
    while asked:
        places = [_with(origins[at][1], origins[at][0] // 2, value) for at, value in asked.items()]
        for at, answer in zip(list(asked), mapper.asked(places), strict=True):
            advance(at, answer=answer)
    return edges


def _refine(mapper: _Mapper, box: Box, rng: np.random.Generator) -> Box:
    for number in range(_ROUNDS):
        probes = _edges(mapper, box, rng)
        if number == 0:
            probes = [(None, place) for place in _corners(mapper, box)] + probes
        known = {place for place, _ in mapper.samples}
        answers = mapper.asked([place for _, place in probes])
        wrong = False
        beyond: list[tuple[int, Place]] = []
        for (side, place), answer in zip(probes, answers, strict=True):
            if answer is None:
                return fit_box(mapper.samples, box)
            wrong = wrong or (answer != box.contains(place) and place not in known)
            if side is not None and answer and not box.contains(place):
                beyond.append((side, place))
        if not wrong:
            return box
        edges = list(box.edges)
        for (side, _), edge in zip(beyond, _shoot(mapper, beyond), strict=True):
            edges[side] = edge
        box = fit_box(mapper.samples, Box(tuple(edges)))
    return box


def _corners(mapper: _Mapper, box: Box) -> list[Place]:
    inset = [min(width, span / 4) for width, span in zip(mapper.widths, box.spans, strict=True)]
    ends = [(low + step, high - step) for (low, high), step in zip(box.ranges, inset, strict=True)]
    return [mapper.sensible(place) for place in islice(product(*ends), _CORNERS)]


def _edges(mapper: _Mapper, box: Box, rng: np.random.Generator) -> list[tuple[int | None, Place]]:
    """Return one place just inside and one just outside each edge, somewhere along it, with the edge's number."""
    probes: list[tuple[int | None, Place]] = []
    for side, (edge, limit) in enumerate(zip(box.edges, mapper.limits, strict=True)):
        axis = side // 2
        outward = 1.0 if side % 2 else -1.0
        width, span = mapper.widths[axis], box.spans[axis]
        for step in (-min(0.8 * width, span / 3), 0.8 * width):
            value = edge + outward * step
            along = tuple(_along(range_, width, rng) for range_, width in zip(box.ranges, mapper.widths, strict=True))
            if step > 0 and (value - limit) * outward > 0:
                if edge == limit:
                    continue
                value = limit
            probes.append((side, mapper.sensible(_with(along, axis, value))))
    return probes


def _along(range_: tuple[float, float], width: float, rng: np.random.Generator) -> float:
    margin = min(width, (range_[1] - range_[0]) / 4)
    return float(rng.uniform(range_[0] + margin, range_[1] - margin))


def _report(mapper: _Mapper, box: Box) -> Region:
    inside = any(box.contains(place) for place, _ in mapper.samples)
    clear = [one for one in mapper.samples if box.clearance(one.place, mapper.widths) > 0.5]
    right = [[failed for place, failed in clear if box.contains(place) is side] for side in (True, False)]
    failing = [place for place, failed in mapper.samples if failed]
    ends = {
        side
        for side, (edge, limit) in enumerate(zip(box.edges, mapper.limits, strict=True))
        if abs(edge - limit) <= mapper.widths[side // 2]
        and any(place[side // 2] == mapper.axes[side // 2].sensible(limit) for place in failing)
    }
    return Region(
        tuple(axis.name for axis in mapper.axes),
        box,
        samples=tuple(mapper.samples),
        good=inside and sum(right[0]) >= FIT * len(right[0]) and sum(right[1]) <= (1 - FIT) * len(right[1]),
        ends=frozenset(ends),
    )
