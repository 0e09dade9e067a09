from __future__ import annotations

from dataclasses import replace

from riot_bus.chain.crash_region import axes_of
from riot_bus.chain.external import ExternalField
from riot_bus.findings.permeability import EdgeRecord, PermeabilityRecord


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
