"""The whole chain over one finding; every step that has finished is read, not repeated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.events import AnalysisFinished, StepStopped
from riot_bus.findings.records import FindingRecord
from riot_bus.findings.steps import STEPS, ChainStep
from riot_bus.report.page import write_report
from riot_bus.vocabulary.errors import InconclusiveError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus.chain.workspace import Workspace

__all__ = ["Analysis", "analyze"]


@dataclass(frozen=True, slots=True)
class Analysis:
    """A finding that has gone through the chain.

    Attributes:
        folder: The finding; `riot_bus.report.finding_view.load` reads all that is known of it.
        report: The page about it.
        stopped: Why the chain ended early; empty if it did not.
    """

    folder: Path
    report: Path
    stopped: str = ""


def analyze(workspace: Workspace, folder: Path, *, further: Sequence[ChainStep] = ()) -> Analysis:
    """Take a finding through all steps; a step that cannot say anything ends the chain, the report is written anyway.

    Args:
        workspace: Where to work.
        folder: The finding.
        further: Steps of other packages, which come after ours.

    Raises:
        ConfigError: `finding.json` or the file of a finished step cannot be used.
    """
    FindingRecord.load(folder)
    outside = bool(workspace.context.file.external.topics)
    stopped = ""
    for step in (*STEPS[1:], *further):
        if step.kind.exists(folder):
            step.kind.load(folder)
            continue
        if step.whole_system and not outside:
            continue
        try:
            workspace.carry_out(step, folder)
        except InconclusiveError as error:
            stopped = str(error)
            workspace.tell(StepStopped(step.name, stopped, str(folder)))
            break
    report = write_report(folder)
    workspace.tell(AnalysisFinished(str(folder), str(report), stopped))
    return Analysis(folder, report, stopped)
