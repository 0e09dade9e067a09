"""`riot demo`: the whole chain on a system, from nothing to the report (the paper's case study, RIOT III)."""

from __future__ import annotations

import time
from typing import Any

from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps.analyze import Analysis, analyze_all
from riot_bus.chain.steps.robustness import test_unit, tested
from riot_bus.log.info import log_info
from riot_bus.report import finding_view as view
from riot_bus.vocabulary.counting import counted


def demo(workspace: Workspace, *, trials: int) -> dict[str, Any]:
    """Record, test, explain and backchain, or go on with that; return the figures."""
    started = time.monotonic()
    unit = workspace.context.file.choose_unit(None)
    with workspace.step("record") as step:
        log = workspace.nominal_log()
        count = log_info(log).count
        step.end(f"nominal run of {workspace.context.file.system.name}: {counted(count, 'message')}")
    folders = tested(workspace, unit)
    if folders is None:
        folders = test_unit(workspace, unit, trials=trials, seconds=None, covered=False)
    figures = {"seed": workspace.seed, "nominal_messages": count}
    analyses = analyze_all(workspace, folders)
    if analyses:
        figures.update(_figures(max(analyses, key=_progress)))
    return {**figures, "findings": [str(folder) for folder in folders], "seconds": round(time.monotonic() - started, 1)}


def _progress(analysis: Analysis) -> tuple[int, int]:
    told = view.load(analysis.folder)
    activated = told.activation is not None and told.activation.found is not None
    return sum(record is not None for _, record in told.steps) + activated, told.finding.occurrences


def _figures(analysis: Analysis) -> dict[str, Any]:
    one = view.load(analysis.folder)
    region = one.activation.region if one.activation else None
    return {
        "seed": one.finding.seed,
        "minimal_messages": len(one.minimal.kept) if one.minimal else None,
        "relevant_fields": [field.name for field in one.fields.fields] if one.fields else [],
        "rule": one.rule.text if one.rule else None,
        "rule_balanced_accuracy": one.rule.balanced_accuracy if one.rule else None,
        "permeable_fields": list(one.permeability.permeable) if one.permeability else [],
        "activation_runs": one.activation.runs if one.activation else None,
        "activation_replay_rate": one.activation.replay_rate if one.activation else None,
        "region": {each.field: (each.low, each.high) for each in region.ranges} if region else None,
        "trials": {step.name: record.trials for step, record in one.steps if record is not None},
        "stopped": analysis.stopped or None,
        "report": str(analysis.report),
        "finding": str(analysis.folder),
    }
