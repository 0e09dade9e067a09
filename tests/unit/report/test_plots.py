from __future__ import annotations

import math
from xml.etree import ElementTree

import pytest

from riot_bus.findings.activation import PointRecord, RangeRecord, RegionRecord
from riot_bus.findings.records import ProportionRecord, RuleRecord, RuleSample
from riot_bus.report.plots import Plot, region_plots, rule_plot

RATE = ProportionRecord(value=1, low=0.9, high=1)


def rule(*samples: tuple[dict[str, bool | int | float | str], bool]) -> RuleRecord:
    return RuleRecord(
        text="x < 0",
        rule={},
        python="",
        precision=RATE,
        recall=RATE,
        balanced_accuracy=1,
        scale={},
        samples=tuple(RuleSample(values=values, failed=failed) for values, failed in samples),
    )


def region(x: tuple[float, float] = (-100, 100), y: tuple[float, float] = (-100, -80)) -> RegionRecord:
    ranges = {"x": x, "y": y}.items()
    return RegionRecord(ranges=tuple(RangeRecord(field=name, low=low, high=high) for name, (low, high) in ranges))


def text(plot: Plot) -> str:
    return " ".join(ElementTree.fromstring(plot.svg).itertext())


def test_rule_with_two_numbers() -> None:
    plot = rule_plot(rule(({"x": -1, "y": 2}, True), ({"x": 3, "y": 4.5}, False), ({"x": 9, "y": 1}, False)))
    assert plot is not None
    assert "failed (1)" in text(plot)
    assert "passed (2)" in text(plot)
    assert "symlog" in plot.caption


@pytest.mark.parametrize("values", [{"x": 1}, {"x": 1, "y": 2, "z": 3}, {"x": 1, "y": "a"}, {"x": 1, "y": True}])
def test_other_rules_have_no_plot(values: dict[str, bool | int | float | str]) -> None:
    assert rule_plot(rule((values, True))) is None


def test_no_samples() -> None:
    assert rule_plot(rule()) is None


def test_extreme_values() -> None:
    plot = rule_plot(
        rule(
            ({"x": math.inf, "y": -math.inf}, True),
            ({"x": 1.7e308, "y": 10**400}, True),
            ({"x": math.nan, "y": 1}, True),
            ({"x": 0, "y": 5e-324}, False),
        )
    )
    assert plot is not None
    assert "failed (2)" in text(plot)


def test_one_place_only() -> None:
    assert rule_plot(rule(({"x": 5, "y": 5}, True))) is not None


def test_names_with_mathematics_and_other_scripts() -> None:
    plot = rule_plot(rule(({"$\\frac{": 1, "\u5730\u56f3<script>": 2}, True)))
    assert plot is not None
    assert "<script>" not in plot.svg
    assert "$\\frac{" in text(plot)


def test_region_maps() -> None:
    points = [
        PointRecord(values={"x": 10, "y": -90}, distance=-1, failed=True),
        PointRecord(values={"x": 10, "y": -10}, distance=4, failed=False),
        PointRecord(values={"x": 4000, "y": -4000}, distance=None, failed=False),
        PointRecord(values={"x": 1}, distance=None, failed=False),
    ]
    zoom, whole = region_plots(points, region(), nominal={"x": (0, 50), "y": (0, 50)})
    assert "refused (0 of 1)" in text(zoom)
    assert "refused (1)" in text(whole)
    for plot in (zoom, whole):
        assert "crash region" in text(plot)
        assert "nominal values" in text(plot)
        assert "style=" not in plot.svg
    assert "nominal values" not in text(region_plots(points, region())[0])


def test_region_without_points() -> None:
    assert len(region_plots([], region())) == 1


@pytest.mark.parametrize("changes", [{"x": (-100, math.inf)}, {"y": (math.nan, -80)}])
def test_unbounded_region_has_no_map(changes: dict[str, tuple[float, float]]) -> None:
    assert region_plots([], region(**changes)) == []


def test_one_field_has_no_map_and_of_three_the_first_two_have() -> None:
    x, y = region().ranges
    assert region_plots([], RegionRecord(ranges=(x,))) == []
    assert len(region_plots([], RegionRecord(ranges=(x, y, x)))) == 1


def test_point_region() -> None:
    flat = region((0, 0), (0, 0))
    points = [PointRecord(values={"x": 0, "y": 0}, distance=0, failed=True)]
    assert len(region_plots(points, flat, nominal={"x": (0, 1), "y": (0, 1)})) == 2
