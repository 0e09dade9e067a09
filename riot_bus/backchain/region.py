"""The crash zone around one failing point, as a box in two external fields (RIOT III, Fig. 2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from riot_bus.backchain.box import Box, Sample, fit_box
from riot_bus.statistics.rates import exact_interval

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping, Sequence

    from riot_bus.backchain.encoding import SearchField
    from riot_bus.vocabulary.trial import Ask, Progress

__all__ = ["Region", "map_region"]

_STRIDE = 4.0
_ROUNDS = 20
_FIT = 0.9

Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Region:
    """A box in which the failure happens.

    Attributes:
        x_name: First field.
        y_name: Second field.
        x_min: Smallest failing value of the first field; so for the others.
        x_max: See `x_min`.
        y_min: See `x_min`.
        y_max: See `x_min`.
        samples: The start and all asked points (x, y, failed), in order.
        inside_share: Share of the samples inside the box that failed.
        inside_low: Lower end of its 95 % interval (Clopper-Pearson). Samples crowd at the edges, so this is cautious.
        inside_high: Upper end.
        outside_share: Share of the samples outside the box that failed.
        good: Whether the box describes the zone: away from its edges, nine of ten samples on either side agree.
        ends: Sides (`x_min`, ...) where it failed at the very end of the field's range: beyond, nothing was tried.
    """

    x_name: str
    y_name: str
    x_min: float
    x_max: float
    y_min: float
    y_max: float
    samples: tuple[Sample, ...]
    inside_share: float
    inside_low: float
    inside_high: float
    outside_share: float
    good: bool
    ends: tuple[str, ...]


def map_region(
    start: Mapping[str, float],
    axes: tuple[SearchField, SearchField],
    ask: Ask[Mapping[str, float]],
    *,
    seed: int,
    budget: int = 80,
    tolerance: float | tuple[float, float],
    parallelism: int = 1,
    progress: Progress | None = None,
) -> Region:
    """Find the boundary of the crash zone around a failing point in two fields.

    First strides and bisection along both axes; then samples at the corners and on either side of each edge, which move
    the edges until a round of them comes out as foretold.

    Args:
        start: A failing point; fields other than the axes keep its values.
        axes: The two fields.
        ask: Whether the failure happens at each point.
        seed: Seed of the choice of samples.
        budget: Largest number of points asked.
        tolerance: Width to which an edge is bracketed, in the fields' units (one number, or one per axis).
        parallelism: Points per call of `ask`.
        progress: Told after each batch.

    Raises:
        ValueError: `tolerance`, `budget` or `parallelism` is not positive, or both axes are one field.
    """
    widths = tolerance if isinstance(tolerance, tuple) else (tolerance, tolerance)
    if min(widths) <= 0 or budget < 1 or parallelism < 1 or axes[0].name == axes[1].name:
        raise ValueError(f"no region map with tolerance {tolerance}, budget {budget}, parallelism {parallelism}")
    mapper = _Mapper(start, axes, widths, ask, budget=budget, parallelism=parallelism, progress=progress)
    first = Box(*_shoot(mapper, [(side, mapper.start) for side in range(4)]))
    box = _refine(mapper, first, np.random.default_rng([seed, 41]))
    return _report(mapper, box)


class _Mapper:
    """Asks within the budget and remembers."""

    def __init__(
        self,
        start: Mapping[str, float],
        axes: tuple[SearchField, SearchField],
        widths: tuple[float, float],
        ask: Ask[Mapping[str, float]],
        *,
        budget: int,
        parallelism: int,
        progress: Progress | None,
    ) -> None:
        self.axes = axes
        self.widths = tuple(
            max(width, 1.0) if axis.integer else width for axis, width in zip(axes, widths, strict=True)
        )
        self.start: Place = (start[axes[0].name], start[axes[1].name])
        self.limits = Box(axes[0].low, axes[0].high, axes[1].low, axes[1].high)
        self.samples: list[Sample] = [(*self.start, True)]
        self._fixed = dict(start)
        self._ask = ask
        self._left = budget
        self._budget = budget
        self._parallelism = parallelism
        self._progress = progress

    def asked(self, places: Sequence[Place]) -> list[bool | None]:
        """Return whether each place fails; None where the budget did not suffice."""
        known: dict[Place, bool] = {(x, y): failed for x, y, failed in self.samples}
        wanted = [self.sensible(place) for place in places]
        new = list(dict.fromkeys(place for place in wanted if place not in known))[: self._left]
        for at in range(0, len(new), self._parallelism):
            batch = new[at : at + self._parallelism]
            points = [self._fixed | {self.axes[0].name: x, self.axes[1].name: y} for x, y in batch]
            for (x, y), failed in zip(batch, self._ask(points), strict=True):
                known[x, y] = failed
                self.samples.append((x, y, failed))
            self._left -= len(batch)
            if self._progress is not None:
                self._progress(self._budget - self._left, self._budget, "boundary of the crash zone")
        return [known.get(place) for place in wanted]

    def sensible(self, place: Place) -> Place:
        """Return a place within the fields' ranges, sensibly rounded."""
        return self.axes[0].sensible(place[0]), self.axes[1].sensible(place[1])


def _ray(start: float, end: float, width: float) -> Generator[float, bool | None, float]:
    """Yield values to ask between a failing one and the end of the range; return where the zone ends."""
    inside, outside = start, end
    sign = math.copysign(1.0, end - start)
    stride = width
    while abs(inside - end) > 0:
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
    """Return where the zone ends from each failing place towards the given side (x_min, x_max, y_min, y_max)."""
    rays = [_ray(place[side // 2], mapper.limits[side], mapper.widths[side // 2]) for side, place in origins]
    edges = [place[side // 2] for side, place in origins]
    waiting: dict[int, float] = {}

    def advance(at: int, *, answer: bool | None) -> None:
        try:
            waiting[at] = rays[at].send(answer)
        except StopIteration as stop:
            waiting.pop(at, None)
            edges[at] = stop.value

    for at in range(len(rays)):
        advance(at, answer=None)
    while waiting:
        now = dict(waiting)
        places = []
        for at, value in now.items():
            side, (x, y) = origins[at]
            places.append((value, y) if side < 2 else (x, value))
        for at, answer in zip(now, mapper.asked(places), strict=True):
            advance(at, answer=answer)
    return edges


def _refine(mapper: _Mapper, box: Box, rng: np.random.Generator) -> Box:
    for number in range(_ROUNDS):
        probes = _edges(mapper, box, rng)
        if number == 0:
            probes = [(None, place) for place in _corners(mapper, box)] + probes
        known = {(x, y) for x, y, _ in mapper.samples}
        answers = mapper.asked([place for _, place in probes])
        wrong = False
        beyond: list[tuple[int, Place]] = []
        for (side, place), answer in zip(probes, answers, strict=True):
            if answer is None:
                return fit_box(mapper.samples, box)
            wrong = wrong or (answer != box.contains(*place) and place not in known)
            if side is not None and answer and not box.contains(*place):
                beyond.append((side, place))
        if not wrong:
            return box
        edges = list(box)
        for (side, _), edge in zip(beyond, _shoot(mapper, beyond), strict=True):
            edges[side] = edge
        box = fit_box(mapper.samples, Box(*edges))
    return box


def _corners(mapper: _Mapper, box: Box) -> list[Place]:
    inset = [min(width, span / 4) for width, span in zip(mapper.widths, box.spans, strict=True)]
    xs = (box.x_min + inset[0], box.x_max - inset[0])
    ys = (box.y_min + inset[1], box.y_max - inset[1])
    return [mapper.sensible((x, y)) for x in xs for y in ys]


def _edges(mapper: _Mapper, box: Box, rng: np.random.Generator) -> list[tuple[int | None, Place]]:
    """Return one place just inside and one just outside each edge, somewhere along it, with the edge's number."""
    probes: list[tuple[int | None, Place]] = []
    for side, (edge, limit) in enumerate(zip(box, mapper.limits, strict=True)):
        axis = side // 2
        outward = 1.0 if side % 2 else -1.0
        width, span = mapper.widths[axis], box.spans[axis]
        along = box[2:] if axis == 0 else box[:2]
        margin = min(mapper.widths[1 - axis], (along[1] - along[0]) / 4)
        for step in (-min(0.8 * width, span / 3), 0.8 * width):
            value = edge + outward * step
            other = float(rng.uniform(along[0] + margin, along[1] - margin))
            if step > 0 and (value - limit) * outward > 0:
                if edge == limit:
                    continue
                value = limit
            place = mapper.sensible((value, other) if axis == 0 else (other, value))
            probes.append((side, place))
    return probes


def _report(mapper: _Mapper, box: Box) -> Region:
    inside = [failed for x, y, failed in mapper.samples if box.contains(x, y)]
    outside = [failed for x, y, failed in mapper.samples if not box.contains(x, y)]
    low, high = exact_interval(sum(inside), len(inside))
    clear = [one for one in mapper.samples if box.clearance(one[0], one[1], mapper.widths) > 0.5]
    right = [[failed for x, y, failed in clear if box.contains(x, y) is side] for side in (True, False)]
    good = bool(inside) and sum(right[0]) >= _FIT * len(right[0]) and sum(right[1]) <= (1 - _FIT) * len(right[1])
    names = mapper.axes[0].name, mapper.axes[1].name
    failing = [one for one in mapper.samples if one[2]]
    tried = [
        abs(edge - limit) <= mapper.widths[side // 2]
        and any(one[side // 2] == mapper.axes[side // 2].sensible(limit) for one in failing)
        for side, (edge, limit) in enumerate(zip(box, mapper.limits, strict=True))
    ]
    ends = tuple(name for name, at_end in zip(Box._fields, tried, strict=True) if at_end)
    return Region(
        *names,
        *box,
        samples=tuple(mapper.samples),
        inside_share=sum(inside) / len(inside) if inside else 0.0,
        inside_low=low,
        inside_high=high,
        outside_share=sum(outside) / len(outside) if outside else 0.0,
        good=good,
        ends=ends,
    )
