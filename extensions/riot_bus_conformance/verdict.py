"""Verdicts of the transparency suite on a running router, one scenario at a time."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from riot_bus_conformance.run import PLAIN, compare, run_scenario
from riot_bus_conformance.scenario import load

_ROUTER = "router"


@dataclass(frozen=True)
class ScenarioVerdict:
    """Result of one scenario."""

    scenario: str
    summary: str
    differences: tuple[str, ...] = ()
    skipped: str | None = None

    def __str__(self) -> str:
        state = "differs" if self.differences else "skipped" if self.skipped else "same"
        lines = [f"{state:8} {self.scenario}: {self.skipped or self.summary}"]
        return "\n".join([*lines, *(f"         {each}" for each in self.differences)])


def verdicts(endpoints: tuple[str, str], *, only: Collection[str] | None = None) -> Iterator[ScenarioVerdict]:
    """Run scenarios between two segments of a running router and through a plain router."""
    for name, scenario in load().items():
        if only is not None and name not in only:
            continue
        ours = run_scenario(scenario, _ROUTER, endpoints)
        if ours.skipped is not None:
            yield ScenarioVerdict(name, scenario.summary, skipped=ours.skipped)
            continue
        plain = run_scenario(scenario, PLAIN)
        known = "native" in scenario.limits  # a documented difference of routers in a chain
        differences = () if known else tuple(map(str, compare([plain, ours])))
        yield ScenarioVerdict(name, scenario.summary, differences, plain.skipped)
