"""The site: a square that the map covers and that the rover does not leave."""

from __future__ import annotations

from math import isfinite

HALF = 100.0


def on_site(x: float, y: float) -> bool:
    """Tell whether a place is known, finite and on the map."""
    return isfinite(x) and isfinite(y) and abs(x) < HALF and abs(y) < HALF
