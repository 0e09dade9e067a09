"""Scatter plots of trials over two fields, as SVG for the page (the paper's figure 2)."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from riot_bus.findings.activation import PointRecord, RegionRecord
from riot_bus.findings.records import RuleRecord
from riot_bus.report.format import clean, number
from riot_bus.report.svg import embed, own_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

Kind = Literal["failed", "passed", "refused"]
Pair = tuple[float, float]

_MOST = 1500  # about 110 bytes of SVG each: 0.5 MB for three kinds of marks
_FAR = 1e30  # replaces infinities; differences of doubles near 1.8e308 would overflow
_INK, _SOFT, _LINE, _FAIL, _PASS, _PAPER, _NOMINAL = (f"#0a0a0{place}" for place in range(1, 8))
_MARKS: dict[Kind, dict[str, Any]] = {
    "refused": {"marker": "+", "s": 16, "c": _SOFT, "linewidths": 0.7},
    "passed": {"marker": "o", "s": 13, "c": "none", "edgecolors": _PASS, "linewidths": 0.9},
    "failed": {"marker": "x", "s": 20, "c": _FAIL, "linewidths": 1.3},
}
_STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.unicode_minus": False,
    "text.color": _INK,
    "axes.labelcolor": _INK,
    "axes.edgecolor": _LINE,
    "axes.linewidth": 0.8,
    "xtick.color": _LINE,
    "ytick.color": _LINE,
    "xtick.labelcolor": _SOFT,
    "ytick.labelcolor": _SOFT,
}


@dataclass(frozen=True, slots=True)
class Dots:
    """Trials of one outcome."""

    kind: Kind
    places: tuple[Pair, ...]


@dataclass(frozen=True, slots=True)
class PlotArea:
    """A part of the plane: the crash region, or the nominal values."""

    kind: Literal["region", "nominal"]
    x: Pair
    y: Pair


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
    return _symlog(dots, (x, y), spread=spread, ident="rule", what="Samples that taught the rule")


def region_plots(
    points: Sequence[PointRecord],
    region: RegionRecord,
    *,
    nominal: Mapping[str, Pair] | None = None,
) -> list[Plot]:
    """Return the map of trials around the crash region, and the one over the whole searched range.

    A region in more fields is drawn in its first two; one of a single field is not drawn.

    Args:
        points: Runs of the whole system.
        region: The crash region.
        nominal: Center and spread of external fields.
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
    boxes = [PlotArea("region", sides[0], sides[1])]
    known = [(nominal or {}).get(name) for name in names]
    nominals = [(one[0] - one[1], one[0] + one[1]) for one in known if one and math.isfinite(one[0] + one[1])]
    if len(nominals) == 2:
        boxes.append(PlotArea("nominal", nominals[0], nominals[1]))
    window = tuple(_window([side, *nominals[place : place + 1]]) for place, side in enumerate(sides))
    svg = draw(dots, labels=names, ident="zoom", title="Around the crash region", boxes=boxes, window=window)
    zoom = Plot(svg, "Around the crash region, linear axes.")
    spread = tuple(max(abs(end) for end in side) for side in sides)
    whole = _symlog(dots, names, spread=(spread[0], spread[1]), ident="whole", what="All runs", boxes=boxes)
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
    low, high = sides[0]
    width = max(high - low, abs(high) * 0.05, 1e-9)
    for side in sides[1:]:
        both = min(low, side[0]), max(high, side[1])
        if both[1] - both[0] <= 8 * width:
            low, high = both
    pad = 0.35 * max(high - low, width)
    return low - pad, high + pad


def _symlog(
    dots: Sequence[Dots],
    names: Pair | tuple[str, str],
    *,
    spread: Pair,
    ident: str,
    what: str,
    boxes: Sequence[PlotArea] = (),
) -> Plot | None:
    if not any(one.places for one in dots):
        return None
    labels = (str(names[0]), str(names[1]))
    linear = (_decade(spread[0]), _decade(spread[1]))
    svg = draw(dots, labels=labels, ident=ident, title=what, boxes=boxes, linear=linear)
    ends = f"linear within ±{number(linear[0])} and ±{number(linear[1])}"
    return Plot(svg, f"{what}: the whole range on symlog axes ({ends}).")


def _decade(spread: float) -> float:
    usable = spread if math.isfinite(spread) and spread > 0 else 1.0
    return float(10.0 ** min(max(math.floor(math.log10(usable)), -12), 12))


def draw(
    dots: Sequence[Dots],
    *,
    labels: tuple[str, str],
    ident: str,
    title: str,
    boxes: Sequence[PlotArea] = (),
    window: tuple[Pair, ...] | None = None,
    linear: Pair | None = None,
) -> str:
    """Return a scatter plot as an SVG element.

    Args:
        dots: Trials, drawn in this order.
        labels: Names of the two fields.
        ident: Prefix of ids, distinct in the page.
        title: Text for screen readers.
        boxes: Shaded parts of the plane.
        window: Limits of both axes; without it, all dots and boxes are inside.
        linear: Half widths of the linear parts of symlog axes; without it, the axes are linear.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    with own_style(_STYLE):
        from matplotlib.figure import Figure

        figure = Figure(figsize=(5.0, 4.0), layout="constrained")
        figure.patch.set_visible(False)
        axes = figure.add_subplot()
        axes.patch.set_visible(False)
        _fill(axes, dots, boxes=boxes, window=window)
        _frame(axes, dots, boxes=boxes, window=window, linear=linear)
        axes.set_xlabel(clean(labels[0], limit=48))
        axes.set_ylabel(clean(labels[1], limit=40))
        figure.legend(loc="outside upper center", ncols=3, frameon=False, fontsize=9, handletextpad=0.4)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return embed(buffer.getvalue(), ident=ident, label=title)


def _fill(axes: Axes, dots: Sequence[Dots], *, boxes: Sequence[PlotArea], window: tuple[Pair, ...] | None) -> None:
    from matplotlib.patches import Rectangle

    for box in boxes:
        corner, width, height = (box.x[0], box.y[0]), box.x[1] - box.x[0], box.y[1] - box.y[0]
        look: dict[str, Any] = {
            "edgecolor": _NOMINAL,
            "facecolor": "none",
            "linestyle": "--",
            "label": "nominal values",
        }
        if box.kind == "region":
            look = {"edgecolor": _FAIL, "facecolor": (_FAIL, 0.16), "label": "crash region"}
        axes.add_patch(Rectangle(corner, width, height, linewidth=1.2, zorder=1, **look))
    for one in dots:
        inside = [place for place in one.places if window is None or _within(place, window)]
        if one.places:
            step = max(1, math.ceil(len(inside) / _MOST))
            told = str(len(inside)) if len(inside) == len(one.places) else f"{len(inside)} of {len(one.places)}"
            shown = inside[::step]
            label = f"{one.kind} ({told})" if step == 1 else f"{one.kind} ({told}, every {step}th drawn)"
            axes.scatter([x for x, _ in shown], [y for _, y in shown], label=label, zorder=3, **_MARKS[one.kind])


def _within(place: Pair, window: tuple[Pair, ...]) -> bool:
    return all(low <= one <= high for one, (low, high) in zip(place, window, strict=True))


def _frame(
    axes: Axes, dots: Sequence[Dots], *, boxes: Sequence[PlotArea], window: tuple[Pair, ...] | None, linear: Pair | None
) -> None:
    from matplotlib.ticker import MaxNLocator

    for which in (0, 1):
        values = [place[which] for one in dots for place in one.places]
        values += [end for box in boxes for end in (box.x, box.y)[which]]
        low, high = window[which] if window else (min(values, default=-1.0), max(values, default=1.0))
        low, high = max(low, -_FAR), min(high, _FAR)
        if linear:
            getattr(axes, ("set_xscale", "set_yscale")[which])("symlog", linthresh=linear[which])
        axis: Axis = (axes.xaxis, axes.yaxis)[which]
        if not window:
            low, high = _padded(axis, low, high)
        getattr(axes, ("set_xlim", "set_ylim")[which])(low, high)
        if linear:
            _ticks(axis, linear[which], low=low, high=high)
        else:
            axis.set_major_locator(MaxNLocator(6))
    axes.grid(visible=True, color=_LINE, linewidth=0.5, alpha=0.5)
    axes.set_axisbelow(True)


def _padded(axis: Axis, low: float, high: float) -> Pair:
    transform = axis.get_transform()
    first, last = transform.transform([low, high])
    pad = 0.04 * (last - first) or 0.5
    ends = transform.inverted().transform([first - pad, last + pad])
    return float(ends[0]), float(ends[1])


def _ticks(axis: Axis, linear: float, *, low: float, high: float) -> None:
    first = round(math.log10(linear))
    last = max(first, math.floor(math.log10(max(abs(low), abs(high), linear))))
    step = max(1, math.ceil((last - first + 1) / 4))
    sizes = [10.0**power for power in range(last, first - 1, -step)]
    ticks = [tick for tick in (*(-size for size in sizes), 0.0, *reversed(sizes)) if low <= tick <= high]
    axis.set_ticks(ticks, [_tick(tick) for tick in ticks])
    axis.set_ticks([], minor=True)


def _tick(tick: float) -> str:
    return (
        f"{tick:.0e}".replace("e+0", "e").replace("e-0", "e-").replace("e+", "e") if abs(tick) >= 1e5 else f"{tick:g}"
    )
