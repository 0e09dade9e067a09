"""One self-contained page about how two logs differ."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.log.showing import value_text
from riot_bus.report.formats import write_file
from riot_bus.report.templating import rendered
from riot_bus_logtools.comparison.text import facts, moves, spans

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus_logtools.comparison.result import LogDifference

_WIDTH, _HEIGHT = 480.0, 24.0  # pixels: four for each of 120 parts of a log; a line of text


def write_diff_page(found: LogDifference, path: Path) -> Path:
    """Write the page, topics that differ first; raises MissingExtraError without jinja2, ConfigError if it cannot."""
    page = rendered(
        "diff.html.j2",
        found=found,
        headline=found.headline(),
        facts=facts,
        spans=spans,
        moves=moves,
        text=value_text,
        bars=_bars,
        width=_WIDTH,
        height=_HEIGHT,
        most_topics=200,  # together with fields, this bounds the page at 20,000 rows of fields; it counts the rest
        most_fields=100,
    )
    return write_file(page, path)


def _bars(shares: Sequence[float]) -> str:
    """Return shares along a log as the data of an SVG path; any share above 0 is visible."""
    step = _WIDTH / max(1, len(shares))
    tall = [(number * step, max(2.0, share * _HEIGHT)) for number, share in enumerate(shares) if share > 0.0]
    return "".join(f"M{x:.1f} {_HEIGHT:g}v-{height:.1f}h{step:.1f}v{height:.1f}z" for x, height in tall)
