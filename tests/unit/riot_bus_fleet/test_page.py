from __future__ import annotations

import math
from pathlib import Path

from riot_bus_fleet.logs.near_misses import FleetScan, LogScan, NearMiss
from riot_bus_fleet.page import write_fleet_page


def test_a_picture_has_a_gap_where_nothing_was_judged(tmp_path: Path) -> None:
    nearest = (NearMiss(0.0, 10**9, {"a:x": 9.5}),)
    log = LogScan("l.mcap", "r1", judged=3, holds=1, nearest=nearest, profile=(100.0, math.nan, 0.0, -5.0))
    scan = FleetScan("a:x > 9", 1.0, (log, LogScan("other.mcap", problem="no topic 'a' in the log")))
    text = write_fleet_page(scan, tmp_path / "fleet.html").read_text(encoding="utf-8")
    assert 'class="line" d="M0.0 1.8H60.0M120.0 34.2H180.0L180.0 34.2H240.0"' in text
    assert "1.000 s, holds: a:x = 9.5" in text
    assert "no topic &#39;a&#39; in the log" in text
