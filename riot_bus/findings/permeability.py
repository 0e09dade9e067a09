"""How external fields affect the relevant ones, as data: `permeability.json` (RIOT II-C)."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from riot_bus.findings.records import PLAYED, Artefact, _Model
from riot_bus.vocabulary.counting import counted

Design = Literal["within runs", "between runs", "beyond nominal"]
"""How a pair of fields was tested: many values in each run, one value per run, or one per run beyond nominal."""


class EdgeRecord(_Model):
    """Effect of one external field on one internal field (RIOT II-C); `design` is how it was observed."""

    external: str
    internal: str
    permeable: bool
    strength: float
    low: float
    high: float
    lag_s: float
    p_value: float
    design: Design = "within runs"
    detectable: float | None = Field(default=None, description="share that an effect needs to show, where none did")
    tested: tuple[Design, ...] = Field(default=(), description="all ways in which the pair was tested; none: not known")

    @property
    def limits(self) -> str:
        """Limits of a test that found no effect: how strong one has to be to show, and what was not tried."""
        parts = [] if self.detectable is None else [f"an effect needs a share of {self.detectable:.2g} to show"]
        if self.tested and "beyond nominal" not in self.tested:
            parts.append("nominal values only")
            parts += ["never one value for a whole run"] if "between runs" not in self.tested else []
        return ", ".join(parts)


class StageRecord(_Model):
    """One topic on a path inwards from an external field, and the share of its strongest field that follows it."""

    topic: str
    field: str
    strength: float


class PathRecord(_Model):
    """The most permeable path from an external field to an internal topic: the topics after the field's, inwards."""

    external: str
    stages: tuple[StageRecord, ...]
    unknown: int = Field(default=0, description="paths of which some topic was not looked at, so they may be better")

    def __str__(self) -> str:
        text = " -> ".join([self.external, *(f"{one.field} ({one.strength:.2g})" for one in self.stages)])
        return text + (
            f", as far as is known ({counted(self.unknown, 'path')} not looked at whole)" * bool(self.unknown)
        )


class PermeabilityRecord(Artefact):
    """Which external fields reach the relevant ones, and how strongly."""

    FILE = "permeability.json"
    STEP = "permeability"
    edges: tuple[EdgeRecord, ...]
    runs: int
    pruned: tuple[str, ...] = ()
    untested: dict[str, str] = Field(default={}, description="external fields of which nothing can be told, and why")
    nominal: dict[str, tuple[float, float]] = Field(default={}, description="center and spread per external field")
    tree: list[dict[str, Any]] = Field(default=[])
    intermediate: tuple[EdgeRecord, ...] = Field(
        default=(), description="what external fields do to fields of topics on the way to the relevant ones"
    )
    paths: tuple[PathRecord, ...] = Field(
        default=(), description="the most permeable path to each relevant topic, if it is known"
    )
    system: str = "the system"
    unseen: dict[str, str] = Field(default={}, description="internal fields that nothing is known to reach, and why")
    failed: int = Field(default=0, description="runs that failed as the finding does")
    failing: tuple[dict[str, float], ...] = Field(
        default=(), description="of these, those with one value of each field: the values, as numbers of a search"
    )
    others: dict[str, int] = Field(default={}, description="runs with other failures, by signature")
    played: bool = Field(default=False, description=PLAYED)

    @property
    def summary(self) -> str:
        """Which external fields reach a relevant one."""
        names = ", ".join(self.permeable) or "none"
        fields, runs = counted(len(self.nominal), "external field"), counted(self.runs, "run")
        idle = f" ({counted(len(self.pruned), 'field')} not driven: no way from there)" if self.pruned else ""
        played = ", the outside played from the nominal log" if self.played else ""
        why = "; ".join(dict.fromkeys(self.untested.values()))
        untold = f" ({counted(len(self.untested), 'field')} not tested: {why})" if self.untested else ""
        near = f" ({counted(len(self.nominal_only), 'field')} without an effect had nominal values only)"
        parts = [
            f"{fields} in {runs} of {self.system}{played} -> {names}{idle}{untold}{near * bool(self.nominal_only)}"
        ]
        parts += [f"most permeable path: {path}" for path in self.paths if len(path.stages) > 1]
        parts += [f"what reaches {name} is not known: {why}" for name, why in self.unseen.items()]
        parts += [f"{counted(self.failed, 'run')} failed as the finding does"] if self.failed else []
        parts += [f"{counted(count, 'run')} failed otherwise: {name}" for name, count in self.others.items()]
        return "; ".join(parts)

    @property
    def nominal_only(self) -> tuple[str, ...]:
        """External fields without any effect that were not tested beyond their nominal range."""
        far = {edge.external for edge in self.edges if edge.permeable or "beyond nominal" in edge.tested}
        return tuple(sorted({edge.external for edge in self.edges if edge.tested} - far))

    @property
    def permeable(self) -> tuple[str, ...]:
        """External fields that reach any relevant field, strongest first."""
        best: dict[str, float] = {}
        for edge in self.edges:
            if edge.permeable:
                best[edge.external] = max(best.get(edge.external, 0.0), edge.strength)
        return tuple(sorted(best, key=lambda name: (-best[name], name)))
