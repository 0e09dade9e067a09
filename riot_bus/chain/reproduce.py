"""Does a finding still fail? Fresh trials of its shortest log, never answers from the store."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from riot_bus.chain.logs import FailingLog
from riot_bus.chain.workspace import StepRun
from riot_bus.findings.records import ActivationRecord, FindingRecord, MinimalRecord
from riot_bus.log.reader import read_log
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError
from riot_bus.vocabulary.trial import TestCase, Verdict

if TYPE_CHECKING:
    from pathlib import Path

    from riot_bus.chain.workspace import Workspace

__all__ = ["Reproduction", "reproduce"]


@dataclass(frozen=True, slots=True)
class Reproduction:
    """The answer: in how many of how many fresh trials the same failure came again."""

    answer: Literal["still failing", "fixed"]
    failed: int
    trials: int
    log: str
    detail: str = ""


def reproduce(workspace: Workspace, folder: Path, *, times: int = 3, whole_system: bool = False) -> Reproduction:
    """Play a finding's log to fresh components.

    Args:
        workspace: Where to work.
        folder: The finding.
        times: Fresh trials.
        whole_system: Play the external messages of `activation.mcap` to the whole system instead of the minimal log
            to the unit.

    Raises:
        InconclusiveError: It fails in some trials and passes in others, or fails in another way; or runs of the whole
            system cannot tell.
        ConfigError: There is no log to play.
        EnvironmentFaultError: The components do not start.
    """
    finding = FindingRecord.load(folder)
    registry = workspace.context.registry
    whole_system = whole_system or finding.whole_system
    if whole_system:
        path = folder / ("failure.mcap" if finding.whole_system else "activation.mcap")
        if not path.is_file() or not (finding.whole_system or ActivationRecord.exists(folder)):
            step = "riot test --whole-system" if finding.whole_system else "riot activate"
            raise ConfigError(f"no {path.name}", where=str(folder), hint=f"run `{step}` first")
        messages = read_log(path)
        judged, why = workspace.judged_in_system(finding)
        if why:
            raise InconclusiveError(f"not tested in the whole system: {why}", where=str(folder))
        runner = workspace.runners.system(workspace.context.file.system.trial_run, judged=judged)
    else:
        path = folder / ("minimal.mcap" if MinimalRecord.exists(folder) else "failure.mcap")
        messages = FailingLog.load(path, registry=registry).messages
        runner = workspace.runners.unit(finding.unit, lambda: workspace.known_unit_log(finding.unit))
    outcomes = runner.run(
        [
            TestCase(messages, seed=workspace.seed + number, ordered=finding.ordered and not whole_system)
            for number in range(times)
        ]
    )
    for outcome in outcomes:
        StepRun(workspace, "reproduce").told(outcome)
        if not outcome.judged:
            raise EnvironmentFaultError(outcome.detail)
    failed = sum(outcome.failed_as(finding.signature) for outcome in outcomes)
    others = sorted(
        {outcome.violations[0].signature for outcome in outcomes if outcome.verdict is Verdict.FAIL}
        - {finding.signature}
    )
    if failed == len(outcomes):
        detail = next(one.violations[0].detail for one in outcomes if one.failed_as(finding.signature))
        return Reproduction("still failing", failed, len(outcomes), path.name, detail)
    if failed == 0 and not others:
        return Reproduction("fixed", 0, len(outcomes), path.name)
    raise InconclusiveError(
        f"{failed} of {counted(len(outcomes), 'trial')} of {path.name} fail as before"
        + (f", others fail differently: {', '.join(others)}" if others else ""),
        hint="repeat with --times for a clearer picture",
    )
