"""One self-contained page about how near a fleet's logs came to a rule."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from riot_bus.report.formats import write_file
from riot_bus.report.templating import rendered

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus_fleet.logs.near_misses import FleetScan

_WIDTH, _HEIGHT = 240.0, 36.0
_HIGHEST = math.asinh(30.0)
"""Upper end of a plot: all distances beyond thirty spreads are drawn alike."""


def write_fleet_page(scan: FleetScan, path: Path) -> Path:
    """Write a page of robots and logs, nearest first; raises MissingExtraError without jinja2."""
    paths = {log.place: _path(log.profile) for log in scan.logs}
    levels = {"met": _place(0.0), "within": _place(scan.within)}
    page = rendered("fleet.html.j2", scan=scan, paths=paths, width=_WIDTH, height=_HEIGHT, **levels)
    return write_file(page, path)


def _place(distance: float) -> float:
    """Return the position of a distance in a plot, from the top; what meets the rule is at the bottom."""
    return _HEIGHT * (1 - min(1.0, math.asinh(max(0.0, distance)) / _HIGHEST)) * 0.9 + 0.05 * _HEIGHT


def _path(profile: Sequence[float]) -> str:
    """Return a distance over time as the data of an SVG path, with gaps where there is none."""
    step, parts, pen = _WIDTH / max(1, len(profile)), [], "M"
    for number, distance in enumerate(profile):
        if math.isnan(distance):
            pen = "M"
            continue
        y = _place(distance)
        parts.append(f"{pen}{number * step:.1f} {y:.1f}H{(number + 1) * step:.1f}")
        pen = "L"
    return "".join(parts)
