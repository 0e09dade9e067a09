"""Warnings before a rule is met: few, and none twice for one approach."""

from __future__ import annotations

from pathlib import Path

from riot_bus.types.registry import TypeRegistry
from riot_bus_fleet.scan import ScanRule
from riot_bus_fleet.watch import RuleWatch
from tests.unit.riot_bus_fleet.test_scan import FAST, message, write_rule


def watched(folder: Path, speeds: list[float | None]) -> tuple[RuleWatch, list[int]]:
    watch = RuleWatch(ScanRule(write_rule(folder, FAST, "a", a_x=1.0)), within=2.0, registry=TypeRegistry())
    told = []
    for number, speed in enumerate(speeds):
        if watch.judge(message(number, "a", **({} if speed is None else {"x": speed}))) is not None:
            told.append(number)
    watch.judge(message(0, "b", x=99))
    return watch, told


def test_each_approach_is_told_as_it_comes_nearer_and_once_when_the_rule_is_met(tmp_path: Path) -> None:
    speeds = [5, 7.9, 8.1, 8.2, 9.1, 9.2, 9.8, 11, 12, 9.9, 7, 8.5, 5.9, 8.5, 10.5, None]
    watch, told = watched(tmp_path, list(speeds))
    assert [speeds[number] for number in told] == [8.1, 9.1, 9.8, 11, 8.5, 10.5]
    assert told[-2:] == [13, 14]  # at 7 it had not been left, at 5.9 it had
    assert (watch.judged, watch.unknown, watch.met) == (15, 1, 3)
    assert watch.summary() == "the rule was met at 3 of 15 messages; nearest: holds, a:x = 12"


def test_without_any_field_nothing_is_told(tmp_path: Path) -> None:
    watch, told = watched(tmp_path, [None, None])
    assert told == []
    assert watch.summary() == "nothing was judged: 2 messages of the rule's topics came"
