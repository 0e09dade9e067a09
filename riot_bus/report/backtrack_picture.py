"""The way back from a field to the outside as a picture: the outside on the left, what is asked for on the right."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.report.format import clean, share
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError, did_you_mean

if TYPE_CHECKING:
    from riot_bus.findings.backtrack import BacktrackRecord, StepRecord

__all__ = ["check_picture", "draw_picture"]

_FORMATS = (".svg", ".png", ".pdf")
_INK, _SOFT, _OUTSIDE, _TARGET = "#1a1a1a", "#8a8a8a", "#dceaf7", "#f7dcdc"
_COLUMN, _ROW = 3.4, 0.75
"""Inches from topic to topic: room for names of 30 letters, and for the label of each arrow."""


def check_picture(path: Path) -> None:
    """Refuse a picture that could not be drawn, before anything is read.

    Raises:
        ConfigError: Its kind is none of those that are drawn.
        MissingExtraError: matplotlib is not installed.
    """
    if path.suffix.lower() not in _FORMATS:
        hint = did_you_mean(path.suffix, _FORMATS)
        raise ConfigError(f"unknown kind of picture {path.suffix!r}", where=f"--picture {path}", hint=hint)
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise MissingExtraError("matplotlib", "report") from None


def draw_picture(record: BacktrackRecord, path: Path) -> None:
    """Write a picture.

    Args:
        record: What was found.
        path: File, of a kind that `check_picture` accepts.
    """
    import matplotlib
    from matplotlib.figure import Figure

    places = _places(record)
    columns = 1 + max((x for x, _ in places.values()), default=0)
    rows = 1 + max((y for _, y in places.values()), default=0)
    with warnings.catch_warnings(), matplotlib.rc_context():
        warnings.simplefilter("ignore")  # names of topics may use letters that the font lacks
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "riot_bus", "text.parse_math": False})
        figure = Figure(figsize=(_COLUMN * columns, max(_ROW * rows + 0.6, 1.8)))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(-0.5, columns - 0.5)
        axes.set_ylim(-0.8, rows - 0.4)
        for topic, place in places.items():
            _box(axes, topic, place, record)
        for step in record.steps:
            if step.source in places and step.target in places:
                _arrow(axes, step, places)
        legend = (
            "solid: the logs show it, with the share of what the field's own past leaves open; "
            "dotted: no evidence; dashed: inferred"
        )
        axes.text(-0.45, -0.75, legend, fontsize=7, color=_SOFT, va="bottom")
        figure.savefig(path, metadata={"Date": None, "Creator": None} if path.suffix.lower() == ".svg" else None)


def _places(record: BacktrackRecord) -> dict[str, tuple[int, int]]:
    """Return where each topic stands: its column from the left by the steps to what is asked for, then its row."""
    depth = {tree["topic"]: 0 for tree in record.trees}
    waiting: list[tuple[dict[str, Any], int]] = [(tree, 0) for tree in record.trees]
    for node, far in waiting:  # grows: near ones first
        depth.setdefault(node["topic"], far)
        waiting += [(hop, far + 1) for hop in node["hops"]]
    deepest = max(depth.values(), default=0)
    rows: dict[int, int] = {}
    places = {}
    for topic, far in depth.items():
        column = 0 if topic in record.externals and far else deepest - far
        places[topic] = (column, rows.get(column, 0))
        rows[column] = rows.get(column, 0) + 1
    return places


def _box(axes: Any, topic: str, place: tuple[int, int], record: BacktrackRecord) -> None:
    asked = [name for name in record.targets if name.rpartition(":")[0] == topic]
    colour = _TARGET if asked else _OUTSIDE if topic in record.externals else "white"
    text = "\n".join([clean(topic, limit=34), *(clean(name.rpartition(":")[2], limit=34) for name in asked[:3])])
    frame = {"boxstyle": "round", "facecolor": colour, "edgecolor": _SOFT if topic in record.missing else _INK}
    frame["linestyle"] = "--" if topic in record.missing else "-"
    axes.text(*place, text, ha="center", va="center", fontsize=8, color=_INK, bbox=frame, zorder=3)


def _arrow(axes: Any, step: StepRecord, places: dict[str, tuple[int, int]]) -> None:
    start, end = places[step.source], places[step.target]
    best = next((one for one in step.evidence if one.found), None)
    style = "--" if step.inferred else "-" if best is not None else ":"
    bend = 0.3 if start[0] >= end[0] else 0.05
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "linestyle": style, "color": _INK if best is not None else _SOFT}
    arrow |= {"shrinkA": 38, "shrinkB": 38, "connectionstyle": f"arc3,rad={bend}"}
    axes.annotate("", xy=end, xytext=start, arrowprops=arrow, zorder=1)
    label = clean(", ".join(step.components), limit=30)
    if best is not None and best.strength is not None:
        label += f"\n{share(best.strength)}"
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    axes.text(*middle, label, ha="center", va="center", fontsize=6.5, color=_SOFT, zorder=2)
