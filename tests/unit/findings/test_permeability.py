from __future__ import annotations

from riot_bus.findings.permeability import EdgeRecord, PermeabilityRecord


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
