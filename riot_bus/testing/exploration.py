"""A small campaign within a test: what it finds is the test's failure, explained as far as asked."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.chain.robustness import test_unit as run_campaign
from riot_bus.chain.workspace import Workspace
from riot_bus.findings.records import CampaignRecord
from riot_bus.findings.steps import find_step
from riot_bus.report.text import summary
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import InconclusiveError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus.sut.runners import RunnerFactory

__all__ = ["EXPLAINED", "explore"]

EXPLAINED = ("minimize", "relevance", "rules")
"""Steps that say what a failure needs and when it comes; they ask the unit alone."""


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
    """Test a unit with exceptional values, and explain what fails.

    Trials that were done for the same code are not done again: they are kept in the output folder.

    Args:
        system: Path of riot.toml.
        out: Folder for everything that is written.
        unit: The unit; None for the only one.
        trials: Budget: injected trials.
        seconds: Budget: time.
        seed: Seed of everything random.
        jobs: Trials at once; 0 for what the machine has.
        steps: Steps of the chain that explain a finding.
        runners: Give the runners; processes of this machine by default.

    Returns:
        What was tried, and found not to fail.

    Raises:
        AssertionError: The unit fails: with the minimal log, the rule and the line that reproduces it.
        InconclusiveError: No trial failed, and yet nothing can be concluded.
        ConfigError: riot.toml is wrong, or there is no such unit.
        EnvironmentFaultError: The components do not start.
    """
    __tracebackhide__ = True
    found: list[str] = []
    with Workspace(system, out, jobs=jobs, seed=seed, runners=runners) as workspace:
        name, _ = workspace.unit(unit)
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
