from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.backchain.region import Region, map_region
from riot_bus.chain.base.external import ExternalField
from riot_bus.chain.whole.crash_region import FOLDER, RegionRule, axes_of, box_rule, with_simple_limits
from riot_bus.findings.permeability import EdgeRecord, PermeabilityRecord
from riot_bus.findings.records import RuleSample
from riot_bus.generalize.rule import Rule
from riot_bus.interceptors.guard import RuleGuard
from riot_bus.vocabulary.injection import PARAMETERS
from riot_bus_fleet.scan import ScanRule


def test_the_strongest_field_of_each_relevant_one_comes_first() -> None:
    def edge(external: str, internal: str, strength: float, *, permeable: bool = True) -> EdgeRecord:
        return EdgeRecord(
            external=external, internal=internal, strength=strength, permeable=permeable, low=0, high=1, lag_s=0,
            p_value=0,
        )  # fmt: skip

    edges = (edge("a", "x", 0.9), edge("b", "x", 0.8), edge("c", "y", 0.3), edge("d", "y", 0.9, permeable=False))
    fields = {name: ExternalField(name, "", "", "float64", 0, 1, 0, 1, (0, 1), 1) for name in "abc"}
    assert axes_of(PermeabilityRecord(edges=edges, runs=8), fields) == ["a", "c", "b"]
    both = (edge("a", "x", 0.9), edge("a", "y", 0.8))
    assert axes_of(PermeabilityRecord(edges=both, runs=8), fields) == ["a"]
    texts = fields | {"c": replace(fields["c"], choices=("on", "off"))}
    assert axes_of(PermeabilityRecord(edges=edges, runs=8), texts) == ["a", "b"]


X = ExternalField("/goal:x", "/goal", "x", "float64", 0.0, 10.0, -20.0, 20.0, (-5000.0, 5000.0), 1.0)
N = ExternalField("/goal:n", "/goal", "n", "uint8", 100.0, 20.0, 50.0, 150.0, (0.0, 255.0), 1.0)
FLAG = ExternalField("/goal:on", "/goal", "on", "bool", 0.0, 0.5, 0.0, 1.0, (0.0, 1.0), 1.0)
GEAR = ExternalField("/goal:gear", "/goal", "gear", "string", 0.0, 0.5, 0.0, 2.0, (0.0, 2.0), 1.0, ("a", "b", "c"))


def mapped(start: dict[str, float], limits: dict[str, tuple[float, float]], *fields: ExternalField) -> Region:
    """Return the region that is found where a system fails within limits."""
    return map_region(
        start,
        [each.search_field() for each in fields],
        lambda points: [all(low <= point[name] <= high for name, (low, high) in limits.items()) for point in points],
        seed=1,
        tolerance=[0.05 * each.spread for each in fields],
    )


@given(
    st.floats(-4000, -30),
    st.floats(30, 4000),
    st.integers(101, 130),
    st.integers(140, 200),
)
def test_limits_get_simpler_and_keep_every_sample_on_its_side(low: float, high: float, first: int, last: int) -> None:
    limits = {X.name: (low, high), N.name: (first, last)}
    region = mapped({X.name: 0.0, N.name: 135.0}, limits, X, N)
    simple = with_simple_limits(region, [X, N], region.samples)
    for place, _ in region.samples:
        assert simple.box.contains(place) == region.box.contains(place)
    for old, new in zip(region.box.edges, simple.box.edges, strict=True):
        assert len(f"{new:g}") <= len(f"{old:.17g}")
    assert all(edge.is_integer() for edge in simple.box.edges[2:])


def test_the_limits_of_a_box_are_a_rule(tmp_path: Path) -> None:
    limits = {X.name: (-80.0, 5000.0), N.name: (120.0, 180.0)}
    region = mapped({X.name: 5.0, N.name: 150.0}, limits, X, N)
    region = with_simple_limits(region, [X, N], region.samples)
    found = box_rule(region, [X, N], {GEAR.name: "c"}, region.samples)
    assert found is not None
    assert found.rule.text() == '/goal:gear == "c" and /goal:x >= -80 and /goal:n >= 120 and /goal:n <= 180'
    found.save(tmp_path, [X, N, GEAR])
    scan = ScanRule(tmp_path / FOLDER)
    assert scan.names == ("/goal:gear", "/goal:n", "/goal:x")
    assert RuleGuard(tmp_path / FOLDER / "rule.json", "hold").topics == ["/goal"]


def test_a_boolean_has_a_value_instead_of_limits() -> None:
    region = mapped({FLAG.name: 1.0}, {FLAG.name: (1.0, 1.0)}, FLAG)
    simple = with_simple_limits(region, [FLAG], region.samples)
    found = box_rule(simple, [FLAG], {}, region.samples)
    assert found is not None
    assert found.rule.text() == "/goal:on == True"


def test_what_fails_everywhere_has_no_rule() -> None:
    region = mapped({X.name: 5.0}, {}, X)
    assert box_rule(region, [X], {}, region.samples) is None


def test_a_rule_about_parameters_is_not_written_for_logs_have_none(tmp_path: Path) -> None:
    speed = replace(X, name=f"{PARAMETERS}:speed", topic=PARAMETERS)
    rule = RegionRule(Rule(()), [RuleSample(values={speed.name: 1.0}, failed=True)])
    rule.save(tmp_path, [speed])
    assert not (tmp_path / FOLDER).exists()


@pytest.mark.parametrize(
    ("tested", "holds"),
    [
        ([(True, True)] * 9 + [(True, False)] + [(False, False)] * 10, True),
        ([(True, True)] * 8 + [(True, False)] * 2 + [(False, False)] * 10, False),
        ([(True, True)] * 10 + [(False, False)] * 8 + [(False, True)] * 2, False),
        ([(True, True)] * 10, False),  # nothing was asked for which it does not hold
        ([(False, False)] * 10, False),  # nothing was asked for which it holds
        ([(True, True)] + [(False, False)] * 10, False),  # hardly anything was
    ],
)
def test_a_rule_holds_if_nine_of_ten_fresh_runs_say_so_on_either_side(
    tested: list[tuple[bool, bool]], holds: bool
) -> None:
    assert RegionRule(Rule(()), [], tested).holds is holds
