"""The whole chain over one finding; every step that has finished is read, not repeated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from riot_bus.chain.activation import activation
from riot_bus.chain.minimize import minimize
from riot_bus.chain.permeability import permeability
from riot_bus.chain.relevance import relevance
from riot_bus.chain.rules import rules
from riot_bus.findings.records import (
    ActivationRecord,
    Artefact,
    FieldsRecord,
    FindingRecord,
    MinimalRecord,
    PermeabilityRecord,
    RuleRecord,
)
from riot_bus.report.page import write_report
from riot_bus.vocabulary.errors import InconclusiveError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from riot_bus.chain.workspace import Workspace

__all__ = ["Analysis", "Budget", "analyze"]

RecordT = TypeVar("RecordT", bound=Artefact)


@dataclass(frozen=True, slots=True)
class Budget:
    """Trials that the steps may spend."""

    rules: int = 160
    validation: int = 60
    runs: int = 8
    activation: int = 200


@dataclass(frozen=True, slots=True)
class Analysis:
    """What is known of a finding; None for steps that could not be done, and why."""

    folder: Path
    finding: FindingRecord
    minimal: MinimalRecord | None = None
    fields: FieldsRecord | None = None
    rule: RuleRecord | None = None
    permeability: PermeabilityRecord | None = None
    activation: ActivationRecord | None = None
    report: Path | None = None
    stopped: str = ""


def analyze(workspace: Workspace, folder: Path, *, budget: Budget | None = None) -> Analysis:
    """Take a finding through all steps; a step that cannot say anything ends the chain, the report is written anyway.

    Args:
        workspace: Where to work.
        folder: The finding.
        budget: What the steps may spend.
    """
    budget = budget or Budget()
    finding = FindingRecord.load(folder)
    done: dict[str, Artefact] = {}
    steps: list[tuple[str, type[Artefact], Callable[[], Artefact]]] = [
        ("minimal", MinimalRecord, lambda: minimize(workspace, folder)),
        ("fields", FieldsRecord, lambda: relevance(workspace, folder)),
        ("rule", RuleRecord, lambda: rules(workspace, folder, budget=budget.rules, validation=budget.validation)),
    ]
    if workspace.context.file.external.topics:
        steps += [
            ("permeability", PermeabilityRecord, lambda: permeability(workspace, folder, runs=budget.runs)),
            ("activation", ActivationRecord, lambda: activation(workspace, folder, budget=budget.activation)),
        ]
    stopped = ""
    for name, kind, step in steps:
        try:
            done[name] = kind.load(folder) if kind.exists(folder) else step()
        except InconclusiveError as error:
            stopped = str(error)
            workspace.narrator.end(name, stopped)
            break
    report = write_report(folder)
    return Analysis(folder, finding, **done, report=report, stopped=stopped)  # type: ignore[arg-type]
