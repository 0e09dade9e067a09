"""Budgets with which the steps of a chain fit into a given time: each gets its usual part of what is left."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from riot_bus.chain.base.workspace import Workspace
from riot_bus.findings.records import CampaignRecord
from riot_bus.findings.steps import STEPS, ChainStep

_USUAL = {"minimize": 30, "relevance": 100, "rules": 260, "permeability": 8, "activate": 120}
"""Usual number of trials of each step: those of the demo."""
_MOST = {"rules": 260, "permeability": 12, "activate": 400}
"""Most trials of a step with its default budget, of those steps that are limited; the others end before."""


def budget_within(workspace: Workspace, folder: Path, steps: Sequence[ChainStep], seconds: float) -> dict[str, int]:
    """Return the option that limits the first of some steps, so that time is left for others; none if it suffices."""
    name, option = steps[0].name, next(iter(steps[0].options), None)
    if name not in _MOST or option is None or not isinstance(option.default, int):
        return {}
    costs = {step.name: _seconds_per_trial(workspace, folder, step) for step in steps if step.name in _USUAL}
    share = costs[name] * _USUAL[name] / sum(cost * _USUAL[each] for each, cost in costs.items())
    scale = seconds * share / (costs[name] * _MOST[name])
    return {} if scale >= 1.0 else {option.name: max(option.min or 1, int(option.default * scale))}


def _seconds_per_trial(workspace: Workspace, folder: Path, step: ChainStep) -> float:
    system = workspace.context.file.system
    if step.whole_system:
        pace = system.perturbed_run if step.name == "permeability" else system.trial_run
        return (pace.duration / pace.speed + 0.3) / workspace.jobs
    kinds = [each.kind for each in STEPS[1:] if not each.whole_system]
    records = [kind.load(folder) for kind in kinds if kind.exists(folder)]
    if not any(record.trials for record in records) and CampaignRecord.exists(workspace.out):
        records = [CampaignRecord.load(workspace.out)]
    trials = sum(record.trials for record in records)
    return sum(record.seconds for record in records) / trials if trials else 0.05
