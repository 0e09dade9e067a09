from __future__ import annotations

from riot_bus.findings.permeability import Design, EdgeRecord, PermeabilityRecord


def test_fields_that_reach_any_relevant_one_are_told_once_strongest_first() -> None:
    def edge(external: str, internal: str, strength: float, *, permeable: bool = True) -> EdgeRecord:
        return EdgeRecord(
            external=external,
            internal=internal,
            permeable=permeable,
            strength=strength,
            low=0.0,
            high=1.0,
            lag_s=0.1,
            p_value=0.01,
        )

    edges = (edge("a", "x", 0.2), edge("b", "x", 0.5), edge("a", "y", 0.7), edge("c", "x", 0.9, permeable=False))
    assert PermeabilityRecord(edges=edges, runs=4).permeable == ("a", "b")


def test_where_no_effect_was_found_it_is_told_what_that_means() -> None:
    def edge(*tested: Design, detectable: float | None = 0.123) -> EdgeRecord:
        return EdgeRecord(
            external="a", internal="x", permeable=False, strength=0, low=0, high=1, lag_s=0, p_value=0.5,
            detectable=detectable, tested=tested,
        )  # fmt: skip

    within = edge("within runs")
    share = "an effect needs a share of 0.12 to show"
    assert within.limits == f"{share}, nominal values only, never one value for a whole run"
    assert edge("within runs", "between runs").limits == f"{share}, nominal values only"
    assert edge("within runs", "beyond nominal").limits == share
    assert edge(detectable=None).limits == "", "of an earlier version"
    far = within.model_copy(update={"internal": "y", "tested": ("beyond nominal",)})
    assert PermeabilityRecord(edges=(within,), runs=8).nominal_only == ("a",)
    assert PermeabilityRecord(edges=(within, far), runs=8).nominal_only == ()
    found = within.model_copy(update={"permeable": True})
    assert PermeabilityRecord(edges=(found,), runs=8).nominal_only == ()
