from __future__ import annotations

import json

from riot_bus_fleet.logs.near_misses import FleetScan, LogScan


def test_what_was_not_judged_is_told_once_for_each_reason() -> None:
    logs = tuple(LogScan(f"{number}.mcap", problem="no topic 'a' in the log") for number in range(30))
    found = FleetScan("x > 1", 1.0, (LogScan("good.mcap", judged=3), *logs))
    lines = found.lines()
    assert lines[-12:] == [
        "  no topic 'a' in the log: 30 logs",
        *(f"    {number}.mcap" for number in range(10)),
        "    ... and 20 more",
    ]
    assert json.loads(json.dumps(found.to_json()))["logs"][1]["problem"] == "no topic 'a' in the log"


def test_a_log_that_could_not_be_read_to_its_end_is_told_with_what_it_counts_as() -> None:
    whole, cut = LogScan("a.mcap", judged=3), LogScan("b.mcap", judged=2, problem="it ends in damage")
    assert FleetScan("x > 1", 1.0, (whole,)).summary().endswith("1 farther away, 0 not judged")
    found = FleetScan("x > 1", 1.0, (whole, cut)).summary()
    assert found.endswith("2 farther away, 0 not judged; 1 log only as far as it could be read")
