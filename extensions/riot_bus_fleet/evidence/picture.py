"""The paths from a field back to external topics as a picture and as a Graphviz graph."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.new_file import write_whole
from riot_bus.report.format import clean, share
from riot_bus.report.svg import element, text, width_of
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from riot_bus.findings.backtrack import BacktrackRecord, StepRecord

COLOURS = {"ink": "#1a1a1a", "soft": "#8a8a8a", "outside": "#dceaf7", "target": "#f7dcdc", "paper": "#ffffff"}
"""Of texts, of what is less important, of external topics, of the field's topic, and of the background."""

_COLUMN, _ROW = 245, 54
"""From topic to topic: room for names of 30 letters, and for the label of each arrow."""
_BEND, _LABEL = 0.5, 0.4
"""Shares of an arrow's length: a bend around its column's boxes; the label, where arrows to one topic are apart."""
_LETTER, _SMALL = 8, 6.5
"""Sizes of letters: of topics, and of labels."""
_LEGEND = (
    "solid: the logs show it, with the share of what the field's own past leaves open; "
    "dotted: no evidence; dashed: inferred"
)

Pair = tuple[float, float]


def check_picture(path: Path) -> None:
    """Raise ConfigError if a picture could not be drawn since its suffix is not `.svg`, before anything is read."""
    if path.suffix.lower() != ".svg":
        hint = "name a .svg; other programs convert it, such as rsvg-convert"
        raise ConfigError(f"unknown kind of picture {path.suffix!r}", where=f"--picture {path}", hint=hint)


def write_picture(record: BacktrackRecord, path: Path) -> None:
    """Write a picture to a file."""
    write_whole(path, picture(record) + "\n")


def picture(record: BacktrackRecord, colours: Mapping[str, str] = COLOURS) -> str:
    """Return a picture as SVG: external topics are on the left, the targets on the right."""
    columns = _columns(record)
    most = max(map(len, columns), default=1)
    width, height = _COLUMN * max(1, len(columns)), max(_ROW * most + 43, 130)
    boxes: dict[str, _Box] = {}
    for column, topics in enumerate(columns):
        for row, topic in enumerate(topics):
            y = (height - 30) / 2 + _ROW * (row - (len(topics) - 1) / 2) + 8
            boxes[topic] = _Box(topic, record, (_COLUMN * (column + 0.5), y), colours)
    found = [
        _arrow(step, boxes[step.source], boxes[step.target], colours)
        for step in record.steps
        if step.source in boxes and step.target in boxes
    ]
    return element(
        "svg",
        element("rect", width="100%", height="100%", fill=colours["paper"]),
        *(arrow for arrow, _ in found),
        *(label for _, label in found),
        *(box.drawn for box in boxes.values()),
        text(_LEGEND, 12, height - 8, size=7, fill=colours["soft"], anchor="start"),
        xmlns="http://www.w3.org/2000/svg",
        font_family="system-ui, 'DejaVu Sans', sans-serif",
        **{"width": f"{width}pt", "height": f"{height}pt", "viewBox": f"0 0 {width} {height}"},
    )


def _columns(record: BacktrackRecord) -> list[list[str]]:
    """Return the topics of each column: external ones on the left, others by their steps to the targets."""
    depth: dict[str, int] = {}
    ahead: list[tuple[dict[str, Any], int]] = [(tree, 0) for tree in record.trees]
    for node, far in ahead:  # grows: near ones first
        depth.setdefault(node["topic"], far)
        ahead += [(hop, far + 1) for hop in node["hops"]]
    outside = [topic for topic, far in depth.items() if topic in record.externals and far]
    inner = [topic for topic in depth if topic not in outside]
    furthest = max((depth[topic] for topic in inner), default=0)
    columns = [outside, *([one for one in inner if depth[one] == far] for far in range(furthest, -1, -1))]
    return [topics for topics in columns if topics]


class _Box:
    """A topic, drawn around its place."""

    def __init__(self, topic: str, record: BacktrackRecord, place: Pair, colours: Mapping[str, str]) -> None:
        asked = [name for name in record.targets if name.rpartition(":")[0] == topic]
        lines = [clean(topic, limit=34), *(clean(name.rpartition(":")[2], limit=34) for name in asked[:3])]
        self.place = x, y = place
        self.half = max(width_of(line, _LETTER) for line in lines) / 2 + 2, (10 * len(lines) + 4) / 2
        missing = topic in record.missing
        self.drawn = element(
            "rect",
            **{"x": x - self.half[0], "y": y - self.half[1], "width": 2 * self.half[0], "height": 2 * self.half[1]},
            rx=3,
            fill=colours["target" if asked else "outside" if topic in record.externals else "paper"],
            stroke=colours["soft" if missing else "ink"],
            stroke_dasharray="3.7 1.6" if missing else "none",
        )
        for row, line in enumerate(lines):
            low = y + 10 * (row - (len(lines) - 1) / 2) + 0.36 * _LETTER
            self.drawn += text(line, x, low, size=_LETTER, fill=colours["ink"])

    def holds(self, spot: Pair) -> bool:
        """Return whether a spot is in the box or within 2 of it."""
        return all(abs(one - own) <= half + 2 for one, own, half in zip(spot, self.place, self.half, strict=True))


def _arrow(step: StepRecord, source: _Box, target: _Box, colours: Mapping[str, str]) -> tuple[str, str]:
    """Return an arrow from box to box, and its label."""
    (x, y), (to_x, to_y) = source.place, target.place
    best = next((one for one in step.evidence if one.found), None)
    colour = colours["ink" if best is not None else "soft"]
    dashes = "3.7 1.6" if step.inferred else "none" if best is not None else "1 1.65"
    bend = _BEND if x >= to_x else 0.0  # else it would hide behind the topics of its column
    aside = (bend * (y - to_y), bend * (to_x - x))  # to the right of who goes along the arrow
    control = ((x + to_x) / 2 + aside[0], (y + to_y) / 2 + aside[1])

    def blossom(one: float, other: float) -> Pair:
        """Return a spot of the curve, and for two shares the control point of the part between them."""
        a, b, c = (1 - one) * (1 - other), (1 - one) * other + one * (1 - other), one * other
        return a * x + b * control[0] + c * to_x, a * y + b * control[1] + c * to_y

    shares = [place / 200 for place in range(201)]
    free = [one for one in shares if not source.holds(blossom(one, one)) and not target.holds(blossom(one, one))]
    arrow = ""
    if free:
        (from_x, from_y), (mid_x, mid_y), (end_x, end_y) = (
            blossom(one, other) for one, other in ((free[0],) * 2, (free[0], free[-1]), (free[-1],) * 2)
        )
        line = f"M{from_x:.1f} {from_y:.1f}Q{mid_x:.1f} {mid_y:.1f} {end_x:.1f} {end_y:.1f}"
        arrow = element("path", d=line, fill="none", stroke=colour, stroke_dasharray=dashes)
        along = max(((end_x - mid_x) ** 2 + (end_y - mid_y) ** 2) ** 0.5, 0.1)
        u, v = 4 * (end_x - mid_x) / along, 4 * (end_y - mid_y) / along
        head = f"M{end_x:.1f} {end_y:.1f}l{-u - v / 2:.1f} {u / 2 - v:.1f} {v:.1f} {-u:.1f}z"
        arrow += element("path", d=head, fill=colour, stroke=colour, stroke_linejoin="round")
    words = clean(", ".join(step.components), limit=30)
    if best is not None and best.strength is not None:
        words += f" {share(best.strength)}"
    # Nearer to the source, where arrows to one topic are apart; a bent one leans by half of its bend.
    spot_x, spot_y = x + _LABEL * (to_x - x) + aside[0] / 2, y + _LABEL * (to_y - y) + aside[1] / 2
    wide = width_of(words, _SMALL)
    paper = element("rect", x=spot_x - wide / 2, y=spot_y - 4.5, width=wide, height=9, fill=colours["paper"])
    return arrow, paper + text(words, spot_x, spot_y + 2.3, size=_SMALL, fill=colours["soft"])


def dot(record: BacktrackRecord) -> str:
    """Return the record as a Graphviz graph: topics are ellipses, external ones boxes.

    Steps with evidence are solid, others dotted, inferred ones dashed; labels give components and strength.
    """
    roots = [tree["topic"] for tree in record.trees]
    ends = [end for step in record.steps for end in (step.source, step.target) if end]
    topics = list(dict.fromkeys([*roots, *ends]))
    number = {topic: f"t{place}" for place, topic in enumerate(topics)}
    out = ["digraph riot {", "  rankdir=LR;"]
    for topic in topics:
        shape = "box" if topic in record.externals else "ellipse"
        marks = ", style=dashed" if topic in record.missing else ", penwidth=3" if topic in roots else ""
        out.append(f"  {number[topic]} [shape={shape}, label={_quoted(topic)}{marks}];")
    for step in (one for one in record.steps if one.source):
        best = next((one for one in step.evidence if one.found), None)
        label = ", ".join(step.components)
        if best is not None and best.strength is not None:
            label += f"\n{share(best.strength)}"
        style = "dashed" if step.inferred else "solid" if best is not None else "dotted"
        out.append(f"  {number[step.source]} -> {number[step.target]} [style={style}, label={_quoted(label)}];")
    return "\n".join([*out, "}"]) + "\n"


def _quoted(text: str) -> str:
    plain = "\n".join(clean(one) for one in text.split("\n")).replace("\\", "\\\\").replace('"', '\\"')
    return '"' + plain.replace("\n", "\\n") + '"'
