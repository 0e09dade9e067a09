"""A small campaign within a test: findings fail the test, explained by the requested steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.steps.robustness import test_unit as run_campaign
from riot_bus.findings.records import CampaignRecord
from riot_bus.findings.steps import find_step
from riot_bus.pool.runners import RunnerFactory
from riot_bus.report.text import summary
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import InconclusiveError

EXPLAINED = ("minimize", "relevance", "rules")
"""Steps that find what a failure needs and when it occurs, with trials of the unit alone."""


def explore(
    system: Path,
    out: Path,
    *,
    unit: str | None = None,
    trials: int = 100,
    seconds: float | None = None,
    seed: int = 0,
    jobs: int = 0,
    steps: Sequence[str] = EXPLAINED,
    runners: RunnerFactory | None = None,
) -> CampaignRecord:
    """Test a unit with exceptional values, and explain failures.

    Trials are kept in the output folder and not repeated for the same code.

    Args:
        system: Path of riot.toml.
        out: Output folder.
        unit: Name of the unit; None for the only one.
        trials: Budget of trials with injections.
        seconds: Budget of time, in seconds.
        seed: Seed of all random choices.
        jobs: Number of trials at once; 0 for as many as the machine allows.
        steps: Steps of the chain that explain a finding.
        runners: Factory of the runners; by default, processes on this machine.

    Returns:
        Record of a campaign without failures.

    Raises:
        AssertionError: The unit fails; the text has the minimal log, the rule and the line that reproduces it.
        InconclusiveError: No trial failed, but nothing can be concluded.
        ConfigError: riot.toml is wrong, or there is no such unit.
        EnvironmentFaultError: The components do not start.
    """
    __tracebackhide__ = True
    found: list[str] = []
    with Workspace(system, out, jobs=jobs, seed=seed, runners=runners) as workspace:
        name = workspace.context.file.choose_unit(unit)
        folders = run_campaign(workspace, name, trials=trials, seconds=seconds, covered=False)
        for folder in folders:
            stopped = ""
            for step in map(find_step, steps):
                if step.kind.exists(folder):
                    continue
                try:
                    workspace.carry_out(step, folder)
                except InconclusiveError as error:
                    stopped = f"\n  {step.name}: {error}"
                    break
            found.append(summary(folder) + stopped)
    record = CampaignRecord.load(out)
    if found:
        told = f"{counted(len(found), 'finding')} in {counted(record.tested, 'trial')} of {name}"
        raise AssertionError("\n\n".join([told, *found]))
    if record.doubts:
        raise InconclusiveError("; ".join(record.doubts), where=name)
    return record
