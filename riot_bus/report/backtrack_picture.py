"""Picture of the paths from a field back to external topics, which are on the left; the targets are on the right."""

from __future__ import annotations

import io
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.report.format import clean, share
from riot_bus.report.svg import own_style
from riot_bus.vocabulary.errors import ConfigError, did_you_mean, needs_extra

if TYPE_CHECKING:
    from riot_bus.findings.backtrack import BacktrackRecord, StepRecord

_FORMATS = (".svg", ".png", ".pdf")
_NO_DATES: dict[str, dict[str, Any]] = {"svg": {"Date": None, "Creator": None}, "pdf": {"CreationDate": None}}
_INK, _SOFT, _OUTSIDE, _TARGET = "#1a1a1a", "#8a8a8a", "#dceaf7", "#f7dcdc"
_COLUMN, _ROW = 3.4, 0.75
"""Inches from topic to topic: room for names of 30 letters, and for the label of each arrow."""

_BEND, _LABEL = 0.5, 0.4
"""Shares of an arrow's length: a bend around its column's boxes; the label, where arrows to one topic are apart."""


def check_picture(path: Path) -> None:
    """Raise an error for a picture that could not be drawn, before anything is read.

    Raises:
        ConfigError: Its suffix is not supported.
        MissingExtraError: matplotlib is not installed.
    """
    if path.suffix.lower() not in _FORMATS:
        hint = did_you_mean(path.suffix, _FORMATS)
        raise ConfigError(f"unknown kind of picture {path.suffix!r}", where=f"--picture {path}", hint=hint)
    with needs_extra("matplotlib", "report"):
        import matplotlib  # noqa: F401


def draw_picture(record: BacktrackRecord, path: Path) -> None:
    """Write a picture.

    Args:
        record: Record of what was found.
        path: File to write, of a kind that `check_picture` accepts.
    """
    from matplotlib.figure import Figure

    places = _places(record)
    columns = 1 + max((x for x, _ in places.values()), default=0)
    rows = 1 + max((y for _, y in places.values()), default=0.0)
    with own_style({}):
        figure = Figure(figsize=(_COLUMN * columns, max(_ROW * rows + 0.6, 1.8)))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(-0.5, columns - 0.5)
        axes.set_ylim(-0.8, rows - 0.4)
        boxes = {topic: _box(axes, topic, place, record) for topic, place in places.items()}
        for step in record.steps:
            if step.source in places and step.target in places:
                _arrow(axes, step, places, boxes)
        legend = (
            "solid: the logs show it, with the share of what the field's own past leaves open; "
            "dotted: no evidence; dashed: inferred"
        )
        axes.text(-0.45, -0.75, legend, fontsize=7, color=_SOFT, va="bottom")
        kind = path.suffix.lower().removeprefix(".")
        draw = partial(figure.savefig, format=kind, metadata=_NO_DATES.get(kind))
        draw(io.BytesIO())  # a first pass sets the sizes of the boxes, at which arrows end
        draw(path)


def _places(record: BacktrackRecord) -> dict[str, tuple[float, float]]:
    """Return the position of each topic: external ones on the left, others by their steps to the targets."""
    depth: dict[str, int] = {}
    ahead: list[tuple[dict[str, Any], int]] = [(tree, 0) for tree in record.trees]
    for node, far in ahead:  # grows: near ones first
        depth.setdefault(node["topic"], far)
        ahead += [(hop, far + 1) for hop in node["hops"]]
    outside = {topic for topic, far in depth.items() if topic in record.externals and far}
    inner = 1 + max((far for topic, far in depth.items() if topic not in outside), default=0)
    columns: dict[int, list[str]] = {}
    for topic, far in depth.items():
        columns.setdefault(0 if topic in outside else inner - far, []).append(topic)
    first = min(columns, default=0)
    most = max(map(len, columns.values()), default=1)
    return {
        topic: (float(column - first), (most - len(some)) / 2 + len(some) - 1 - row)
        for column, some in columns.items()
        for row, topic in enumerate(some)
    }


def _box(axes: Any, topic: str, place: tuple[float, float], record: BacktrackRecord) -> Any:
    asked = [name for name in record.targets if name.rpartition(":")[0] == topic]
    colour = _TARGET if asked else _OUTSIDE if topic in record.externals else "white"
    text = "\n".join([clean(topic, limit=34), *(clean(name.rpartition(":")[2], limit=34) for name in asked[:3])])
    frame = {"boxstyle": "round", "facecolor": colour, "edgecolor": _SOFT if topic in record.missing else _INK}
    frame["linestyle"] = "--" if topic in record.missing else "-"
    return axes.text(*place, text, ha="center", va="center", fontsize=8, color=_INK, bbox=frame, zorder=3)


def _arrow(axes: Any, step: StepRecord, places: dict[str, tuple[float, float]], boxes: dict[str, Any]) -> None:
    (x, y), (to_x, to_y) = start, end = places[step.source], places[step.target]
    best = next((one for one in step.evidence if one.found), None)
    style = "--" if step.inferred else "-" if best is not None else ":"
    bend = _BEND if x >= to_x else 0.0  # else it would hide behind the topics of its column
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "linestyle": style, "color": _INK if best is not None else _SOFT}
    ends = {"patchA": boxes[step.source].get_bbox_patch(), "patchB": boxes[step.target].get_bbox_patch()}
    arrow |= {**ends, "shrinkA": 2, "shrinkB": 2, "connectionstyle": f"arc3,rad={bend}"}
    axes.annotate("", xy=end, xytext=start, arrowprops=arrow, zorder=1)
    label = clean(", ".join(step.components), limit=30)
    if best is not None and best.strength is not None:
        label += f" {share(best.strength)}"
    # Nearer to the source, where arrows to one topic are apart; a bent one leans to its right by half of its bend.
    middle = (x + _LABEL * (to_x - x) + bend / 2 * (to_y - y) * _ROW / _COLUMN, y + _LABEL * (to_y - y))
    paper = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none"}
    axes.text(*middle, label, ha="center", va="center", fontsize=6.5, color=_SOFT, bbox=paper, zorder=2)
