"""Scatter plots of trials over two fields, as SVG for the page (the paper's figure 2)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from riot_bus.findings.activation import PointRecord, RegionRecord
from riot_bus.findings.records import RuleRecord
from riot_bus.report.format import clean, number
from riot_bus.report.svg import Axis, element, text, width_of

Kind = Literal["failed", "passed", "refused"]
Pair = tuple[float, float]

_FAR = 1e30  # replaces infinities; differences of doubles near 1.8e308 would overflow
_WIDTH, _HEIGHT, _MARGIN = 360, 288, 10
_SIZE = 9.5
"""Of letters, in the same unit."""
_SOFT, _LINE = "var(--soft)", "var(--line)"
_MARKS: dict[Kind, tuple[str, dict[str, Any]]] = {
    "refused": ("m-2 0h4m-2-2v4", {"stroke": _SOFT, "stroke_width": 0.7}),
    "passed": ("m-1.8 0a1.8 1.8 0 1 0 3.6 0a1.8 1.8 0 1 0-3.6 0", {"stroke": "var(--pass)", "stroke_width": 0.9}),
    "failed": ("m-2.2-2.2l4.4 4.4m0-4.4l-4.4 4.4", {"stroke": "var(--fail)", "stroke_width": 1.3}),
}
"""The path of each mark around its place, and how it is drawn."""
_REGION = {"stroke": "var(--fail)", "stroke_width": 1.2, "fill": "var(--fail)", "fill_opacity": "0.16"}
_NOMINAL = {"stroke": "var(--nominal)", "stroke_width": 1.2, "stroke_dasharray": "4.4 1.9", "fill": "none"}


@dataclass(frozen=True, slots=True)
class Dots:
    """Trials of one outcome."""

    kind: Kind
    places: tuple[Pair, ...]


@dataclass(frozen=True, slots=True)
class PlotArea:
    """A part of the plane: the crash region, or the nominal values."""

    label: str
    x: Pair
    y: Pair
    look: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Plot:
    """A finished picture and what it shows."""

    svg: str
    caption: str


def rule_plot(record: RuleRecord) -> Plot | None:
    """Return the samples of a rule with exactly two numeric fields, else nothing."""
    taught = [sample for sample in record.samples if sample.phase != "context"]
    names = sorted({name for sample in taught for name in sample.values})
    if len(names) != 2:
        return None
    x, y = names
    if any(isinstance(entry, bool | str) for sample in taught for entry in sample.values.values()):
        return None
    dots = [
        Dots(kind, _places(((one.values, one.failed == (kind == "failed")) for one in taught), x, y))
        for kind in ("passed", "failed")
    ]
    spread = (record.scale.get(x, 1.0), record.scale.get(y, 1.0))
    return _symlog(dots, (x, y), spread=spread, what="Samples that taught the rule")


def region_plots(
    points: Sequence[PointRecord],
    region: RegionRecord,
    *,
    nominal: Mapping[str, Pair] | None = None,
) -> list[Plot]:
    """Return the map of trials around the crash region, and the one over the whole searched range.

    A region in more fields is drawn in its first two; one of a single field is not drawn.
    Of external fields, `nominal` has center and spread.
    """
    if len(region.ranges) < 2:
        return []
    first, second = region.ranges[:2]
    names = (first.field, second.field)
    kinds: tuple[Kind, ...] = ("refused", "passed", "failed")
    dots = [Dots(kind, _places(((one.values, _kind(one) == kind) for one in points), *names)) for kind in kinds]
    sides = [(first.low, first.high), (second.low, second.high)]
    if not all(math.isfinite(end) for side in sides for end in side):
        return []
    areas = [PlotArea("crash region", sides[0], sides[1], _REGION)]
    known = [(nominal or {}).get(name) for name in names]
    nominals = [(one[0] - one[1], one[0] + one[1]) for one in known if one and math.isfinite(one[0] + one[1])]
    if len(nominals) == 2:
        areas.append(PlotArea("nominal values", nominals[0], nominals[1], _NOMINAL))
    x, y = (Axis(*_window([side, *nominals[place : place + 1]])) for place, side in enumerate(sides))
    zoom = Plot(_draw(dots, areas, x, y, names, "Around the crash region"), "Around the crash region, linear axes.")
    spread = tuple(max(abs(end) for end in side) for side in sides)
    whole = _symlog(dots, names, spread=(spread[0], spread[1]), what="All runs", areas=areas)
    return [zoom, whole] if whole else [zoom]


def _kind(point: PointRecord) -> Kind:
    if point.failed:
        return "failed"
    return "refused" if point.distance is None else "passed"


def _places(rows: Iterable[tuple[Mapping[str, Any], bool]], x: str, y: str) -> tuple[Pair, ...]:
    pairs = [(_real(values.get(x)), _real(values.get(y))) for values, wanted in rows if wanted]
    return tuple((one, two) for one, two in pairs if one is not None and two is not None)


def _real(entry: Any) -> float | None:
    try:
        real = float(entry)
    except OverflowError:
        return _FAR if entry > 0 else -_FAR
    except (TypeError, ValueError):
        return None
    return None if math.isnan(real) else min(max(real, -_FAR), _FAR)


def _window(sides: Sequence[Pair]) -> Pair:
    """Return the interval that shows the region, and the nominal values unless they are too far away."""
    low, high = (min(max(end, -_FAR), _FAR) for end in sides[0])
    width = max(high - low, abs(high) * 0.05, 1e-9)
    for side in sides[1:]:
        both = min(low, side[0]), max(high, side[1])
        if both[1] - both[0] <= 8 * width:
            low, high = both
    pad = 0.35 * max(high - low, width)
    return low - pad, high + pad


def _symlog(
    dots: Sequence[Dots], names: tuple[str, str], *, spread: Pair, what: str, areas: Sequence[PlotArea] = ()
) -> Plot | None:
    if not any(one.places for one in dots):
        return None
    axes = []
    for which, linear in enumerate(map(_decade, spread)):
        values = [place[which] for one in dots for place in one.places]
        values += [end for area in areas for end in (area.x, area.y)[which]]
        low, high = max(min(values), -_FAR), min(max(values), _FAR)
        aside = 0.0 if low < high else abs(low) or linear
        axes.append(Axis(low - aside, high + aside, linear))
    x, y = axes
    ends = f"linear within ±{number(x.linear or 0)} and ±{number(y.linear or 0)}"
    return Plot(_draw(dots, areas, x, y, names, what), f"{what}: the whole range on symlog axes ({ends}).")


def _decade(spread: float) -> float:
    usable = spread if math.isfinite(spread) and spread > 0 else 1.0
    return float(10.0 ** min(max(math.floor(math.log10(usable)), -12), 12))


def _draw(dots: Sequence[Dots], areas: Sequence[PlotArea], x: Axis, y: Axis, names: tuple[str, str], title: str) -> str:
    """Return a scatter plot as an SVG element: areas below dots, a legend above, labels left and below."""
    legend, top = _legend(dots, areas, x, y)
    left = _MARGIN + 2 * _SIZE + max((width_of(label, _SIZE) for label in y.ticks().values()), default=0)
    width, height = _WIDTH - _MARGIN - left, _HEIGHT - 3.5 * _SIZE - top
    inset = 0.0 if x.linear is None else 0.04  # symlog axes end at dots, of which no half is cut off

    def across(value: float) -> float:
        return width * (inset + (1 - 2 * inset) * x.share(value))

    def down(value: float) -> float:
        return height * (1 - inset - (1 - 2 * inset) * y.share(value))

    grid: dict[str, Any] = {"stroke": _LINE, "stroke_width": 0.5, "stroke_opacity": "0.5"}
    inside = []
    outside = [element("rect", x=left, y=top, width=width, height=height, fill="none", stroke=_LINE, stroke_width=0.8)]
    for tick, label in x.ticks().items():
        place = across(tick)
        inside.append(element("path", d=f"M{place:.1f} 0v{height:.1f}", **grid))
        middle = min(left + place, _WIDTH - width_of(label, _SIZE) / 2)
        outside.append(text(label, middle, top + height + 1.5 * _SIZE, size=_SIZE, fill=_SOFT))
    for tick, label in y.ticks().items():
        place = down(tick)
        inside.append(element("path", d=f"M0 {place:.1f}h{width:.1f}", **grid))
        outside.append(text(label, left - 5, top + place + 3.5, size=_SIZE, fill=_SOFT, anchor="end"))
    for area in areas:
        (first, last), (low, high) = map(across, area.x), map(down, area.y)
        # A path, as rectangles without a width are not drawn.
        inside.append(element("path", d=f"M{first:.1f} {low:.1f}H{last:.1f}V{high:.1f}H{first:.1f}z", **area.look))
    for one in dots:
        shown, _ = _shown(one, x, y)
        mark, look = _MARKS[one.kind]
        marks = "".join(f"M{across(place[0]):.1f} {down(place[1]):.1f}{mark}" for place in shown)
        inside.append(element("path", d=marks, fill="none", **look))
    middle = top + height / 2
    ink: dict[str, Any] = {"size": _SIZE, "fill": "var(--ink)"}
    return element(
        "svg",
        element("svg", *inside, x=left, y=top, width=width, height=height),  # cuts off what is not within the axes
        *outside,
        *legend,
        text(clean(names[0], limit=48), left + width / 2, _HEIGHT - 0.5 * _SIZE, **ink),
        text(clean(names[1], limit=40), _SIZE, middle, transform=f"rotate(-90 {_SIZE} {middle:.1f})", **ink),
        **{"viewBox": f"0 0 {_WIDTH} {_HEIGHT}", "class": "plot", "role": "img", "aria-label": title},
    )


def _shown(one: Dots, x: Axis, y: Axis) -> tuple[list[Pair], str]:
    """Return the places of dots that are drawn, and what the legend says of them."""
    inside = [place for place in one.places if x.low <= place[0] <= x.high and y.low <= place[1] <= y.high]
    step = max(1, math.ceil(len(inside) / 1500))  # at 40 bytes of SVG each, 0.2 MB for three kinds
    of = "" if len(inside) == len(one.places) else f" of {len(one.places)}"
    every = "" if step == 1 else f", every {step}th drawn"
    return inside[::step], f"{one.kind} ({len(inside)}{of}{every})"


def _legend(dots: Sequence[Dots], areas: Sequence[PlotArea], x: Axis, y: Axis) -> tuple[list[str], float]:
    """Return the elements of a legend in rows, and where it ends."""
    entries = [(area.label, element("rect", x=-7, y=-7, width=13, height=7, **area.look)) for area in areas]
    for one in dots:
        if one.places:
            mark, look = _MARKS[one.kind]
            entries.append((_shown(one, x, y)[1], element("path", d=f"M0-3.5{mark}", fill="none", **look)))
    rows: list[list[tuple[str, str, float]]] = [[]]
    for label, sample in entries:
        width = 26 + width_of(label, _SIZE)
        if rows[-1] and (len(rows[-1]) == 3 or sum(one for *_, one in rows[-1]) + width > _WIDTH):
            rows.append([])
        rows[-1].append((label, sample, width))
    return list(_rows(rows)), 14 * len(rows) + 9


def _rows(rows: Sequence[Sequence[tuple[str, str, float]]]) -> Iterator[str]:
    for row, entries in enumerate(rows):
        place, low = (_WIDTH - sum(width for *_, width in entries)) / 2, 14 * (row + 1)
        for label, sample, width in entries:
            yield element("g", sample, transform=f"translate({place + 8:.1f} {low})")
            yield text(label, place + 19, low, size=_SIZE, fill="var(--ink)", anchor="start")
            place += width
