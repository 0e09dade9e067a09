"""Draw the pictures of the documentation: `python docs/pictures.py` writes them to `docs/pictures/`.

A test holds that they are what this draws. The chain comes from the table of steps, the rover from its riot.toml. The
pictures of a finding come from the records in `docs/rover-finding/`: those of a run of `riot demo`, without pairs of
fields that were not tested and without topics on the way.
"""

from __future__ import annotations

import re
import tomllib
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.backtrack import BacktrackRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.steps import STEPS, ChainStep
from riot_bus.report.plots import region_plots
from riot_bus.report.templating import page_environment
from riot_bus_fleet.evidence.picture import COLOURS, picture

DOCS = Path(__file__).parent
FOLDER = DOCS / "pictures"
FINDING = DOCS / "rover-finding"
ROVER = DOCS.parent / "examples" / "rover" / "riot.toml"

_RULES = """
svg { font-family: system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
.paper { fill: var(--paper); } .box { fill: var(--tint); stroke: var(--soft); }
.group { fill: none; stroke: var(--line); }
.topic { fill: var(--paper); stroke: var(--pass); } .cut { stroke: var(--fail); stroke-width: 2.5; }
.name { fill: var(--ink); font-size: 14px; font-weight: 600; } .word { fill: var(--ink); font-size: 13px; }
.soft { fill: var(--soft); font-size: 13px; } .arrow { fill: none; stroke: var(--soft); stroke-width: 1.3; }
.head { fill: var(--soft); }
:root { --outside: #dceaf7; --target: #f7dcdc; }
@media (prefers-color-scheme: dark) { :root { --outside: #1d3a55; --target: #5a2624; } }
"""
_PAPER = '<rect class="paper" width="100%" height="100%"/>'
_EDGE, _COLUMN, _HALF = 40, 142, 56
"""Of the graph: its margin, the distance of columns, and half the width of a node, which has room for 14 letters."""
_HEAD = (
    '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
    '<path class="head" d="M0 0L8 4L0 8z"/></marker></defs>'
)


def pictures() -> dict[str, str]:
    """Return the SVG of each picture by its name."""
    permeability = PermeabilityRecord.load(FINDING)
    activation = ActivationRecord.load(FINDING)
    assert activation.region is not None
    region = region_plots(activation.points, activation.region, nominal=permeability.nominal)[0]
    return {
        "chain": chain(STEPS),
        "rover": graph(tomllib.loads(ROVER.read_text(encoding="utf-8"))),
        "region": _standalone(region.svg.replace('class="plot"', "")),
        "paths": paths(BacktrackRecord.load(FINDING)),
    }


def chain(steps: tuple[ChainStep, ...]) -> str:
    """Return the chain: a box for each step with the name of its command and of what it writes.

    Args:
        steps: Steps in their order.
    """
    boxes = [("record", "nominal log", False), *((one.name, one.title, one.whole_system) for one in steps)]
    boxes.append(("report", "page to read", False))
    wide, gap, top = 112, 14, 10
    lines = []
    for place, (name, title, _) in enumerate(boxes):
        x = 10 + place * (wide + gap)
        lines.append(f'<rect class="box" x="{x}" y="{top}" width="{wide}" height="52" rx="6"/>')
        lines.append(_text("name", x + wide / 2, top + 22, name))
        lines.append(_text("word", x + wide / 2, top + 41, title))
        if place:
            lines.append(_arrow(f"M{x - gap + 2} {top + 26}H{x - 3}"))
    names = [name for name, *_ in boxes]
    whole = [place for place, (*_, system) in enumerate(boxes) if system]
    for label, first, last in (
        ("a nominal run", 0, 0),
        ("one unit on its own, fast", names.index("test"), whole[0] - 1),
        ("the whole system, from outside", whole[0], whole[-1]),
        ("for a reader", len(boxes) - 1, len(boxes) - 1),
    ):
        left, right = 10 + first * (wide + gap), 10 + last * (wide + gap) + wide
        lines.append(f'<path class="arrow" d="M{left} {top + 66}v5H{right}v-5"/>')
        lines.append(_text("soft", (left + right) / 2, top + 87, label))
    width = 20 + len(boxes) * (wide + gap) - gap
    return _page(width, top + 102, lines, "The steps of the chain and what each of them writes")


def graph(system: dict[str, Any]) -> str:
    """Return who publishes and who reads what, as `riot graph` tells it: components are boxes in their segments.

    Topics are round, with a thick border if they cross between segments.

    Args:
        system: Content of a riot.toml.
    """
    components: dict[str, dict[str, Any]] = system["components"]
    external = [name for name, one in components.items() if one.get("external")]
    arrows = [(name, topic) for name, one in components.items() for topic in one.get("outputs", ())]
    arrows += [(topic, name) for name, one in components.items() for topic in one.get("inputs", ())]
    forward = [arrow for arrow in arrows if arrow[1] not in external]
    layers = _layers(external, forward)
    places = _places(layers, forward)
    low = 60 + 44 * max(y for _, y in places.values()) + 34
    spots = {node: (_EDGE + _COLUMN * x + _HALF, 60 + 44 * y) for node, (x, y) in places.items()}
    lines = []
    for segment in system["system"]["segments"]:
        inside = [name for name, one in components.items() if one.get("segment") == segment]
        made = {topic for name in inside if name not in external for topic in components[name].get("outputs", ())}
        columns = [layers[node] for node in (*inside, *made)]
        left, right = _EDGE + _COLUMN * min(columns) - 12, _EDGE + _COLUMN * max(columns) + 2 * _HALF + 12
        lines.append(f'<rect class="group" x="{left}" y="18" width="{right - left}" height="{low - 18}" rx="8"/>')
        lines.append(_text("soft", (left + right) / 2, 34, f"segment {segment}"))
    for start, end in forward:
        stops = [start, *((start, end, x) for x in range(layers[start] + 1, layers[end])), end]
        lines.append(_arrow(_curve([spots[stop] for stop in stops])))
    for start, end in arrows:
        if end in external:
            (x, y), (to_x, to_y) = spots[start], spots[end]
            left = to_x - _HALF - 24
            bend = f"V{low + 10}q0 10 -10 10H{left + 10}q-10 0 -10 -10V{to_y + 10}q0 -10 10 -10"
            lines.append(_arrow(f"M{x} {y + 14}{bend}H{to_x - _HALF - 2}"))
    crossing = {topic for name in external for topic in components[name].get("outputs", ())}
    for node in layers:
        x, y = spots[node]
        look, round_ = ("box", 4) if node in components else ("topic cut" if node in crossing else "topic", 14)
        lines.append(
            f'<rect class="{look}" x="{x - _HALF}" y="{y - 14}" width="{2 * _HALF}" height="28" rx="{round_}"/>'
        )
        lines.append(_text("name" if node in components else "word", x, y + 4, node))
    width = 2 * _EDGE + _COLUMN * max(layers.values()) + 2 * _HALF
    return _page(width, low + 30, lines, "The components of the rover and the topics between them")


def _layers(first: list[str], arrows: list[tuple[str, str]]) -> dict[str, int]:
    """Return the column of each node: one more than that of what leads to it.

    Args:
        first: Nodes of the first column.
        arrows: Pairs of nodes, without circles.
    """
    layers = dict.fromkeys(first, 0)
    for _ in arrows:
        for start, end in arrows:
            if start in layers:
                layers[end] = max(layers.get(end, 0), layers[start] + 1)
    return layers


def _places(layers: dict[str, int], arrows: list[tuple[str, str]]) -> dict[Any, tuple[int, float]]:
    """Return column and row of each node and of each point at which a long arrow passes a column.

    Nodes of a column are ordered by the mean row of their neighbours, again and again, so that few arrows cross.

    Args:
        layers: Column of each node.
        arrows: Pairs of nodes, from left to right.
    """
    columns: list[list[Any]] = [[node for node in layers if layers[node] == x] for x in range(max(layers.values()) + 1)]
    beside: dict[Any, list[Any]] = {}
    for start, end in arrows:
        stops = [start, *((start, end, x) for x in range(layers[start] + 1, layers[end])), end]
        for one, (left, right) in enumerate(pairwise(stops)):
            beside.setdefault(left, []).append(right)
            beside.setdefault(right, []).append(left)
            if one:
                columns[layers[start] + one].append(left)
    most = max(map(len, columns))
    rows: dict[Any, float] = {}
    for _ in range(12):
        for column in columns:
            known = {node: [rows[each] for each in beside.get(node, ()) if each in rows] for node in column}
            column.sort(key=lambda node: sum(known[node]) / len(known[node]) if known[node] else most)
            rows |= {node: row + (most - len(column)) / 2 for row, node in enumerate(column)}
    return {node: (x, rows[node]) for x, column in enumerate(columns) for node in column}


def _curve(spots: list[tuple[float, float]]) -> str:
    """Return a path from the right side of the first node to the left side of the last one, level in every column.

    Args:
        spots: Centers of the first node, of the gaps in the columns between, and of the last node.
    """
    path = f"M{spots[0][0] + _HALF} {spots[0][1]:g}"
    for (left, y), (right, to_y) in pairwise(spots):
        start, end = left + _HALF, right - _HALF
        middle = (start + end) / 2
        path += f"C{middle:g} {y:g} {middle:g} {to_y:g} {end:g} {to_y:g}H{right + _HALF:g}"
    return path.rpartition("H")[0]


def paths(record: BacktrackRecord) -> str:
    """Return the paths from the field of a finding back to external topics, as `riot backchain --picture` draws them.

    Args:
        record: Record of `riot backchain`.
    """
    return _standalone(picture(record, {name: f"var(--{name})" for name in COLOURS}))


def _page(width: float, height: float, lines: list[str], label: str) -> str:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{label}">'
    )
    return "\n".join([head, _style(), _HEAD, _PAPER, *lines, "</svg>"]) + "\n"


def _text(kind: str, x: float, y: float, text: str) -> str:
    return f'<text class="{kind}" x="{x:g}" y="{y:g}" text-anchor="middle">{escape(text)}</text>'


def _arrow(path: str) -> str:
    return f'<path class="arrow" d="{path}" marker-end="url(#head)"/>'


def _standalone(svg: str) -> str:
    """Return an SVG element of a page as a file of its own, with the colours of riot's pages, light and dark."""
    begin, end = re.search(r"<svg[^>]*>", svg).span()  # type: ignore[union-attr]
    opening = svg[begin:end]
    if "xmlns=" not in opening:
        opening = opening.replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"')
    return f"{opening}\n{_style()}\n{_PAPER}\n{svg[end:]}".rstrip() + "\n"


def _style() -> str:
    colours = str(page_environment().globals["css"]).partition("* {")[0]
    return f"<style>{colours}{_RULES}</style>"


def main() -> None:
    """Write all pictures."""
    FOLDER.mkdir(exist_ok=True)
    for name, svg in pictures().items():
        (FOLDER / f"{name}.svg").write_text(svg, encoding="utf-8")


if __name__ == "__main__":
    main()
