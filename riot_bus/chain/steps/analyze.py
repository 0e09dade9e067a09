"""The whole chain over one finding; every step that has finished is read, not repeated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from riot_bus.chain.base.workspace import Workspace
from riot_bus.chain.unit.absence import other_cause
from riot_bus.events import AnalysisFinished, StepStopped
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.findings.steps import STEPS, ChainStep
from riot_bus.report.page import write_report
from riot_bus.vocabulary.errors import InconclusiveError, OutOfTimeError, PayloadError

_USUAL = {"minimize": 30, "relevance": 100, "rules": 260, "permeability": 8, "activate": 120}
"""Usual number of trials of each step: those of the demo."""
_MOST = {"rules": 260, "permeability": 12, "activate": 400}
"""Most trials of a step with its default budget, of those steps that are limited; the others end before."""


@dataclass(frozen=True, slots=True)
class Analysis:
    """A finding that has gone through the chain.

    Attributes:
        unfinished: Whether it ended early for lack of time.
    """

    folder: Path
    report: Path
    stopped: str = ""
    unfinished: bool = False


Options = Mapping[str, Mapping[str, Any]]


def analyze_all(
    workspace: Workspace, folders: Sequence[Path], *, further: Sequence[ChainStep] = (), options: Options | None = None
) -> list[Analysis]:
    """Take findings through all steps, and further ones found on the way, with another cause of the same failure.

    Arguments are those of `analyze`.
    """
    every = with_other_causes(to_explain(folders))
    return [analyze(workspace, folder, further=further, options=options) for folder, _ in every]


def to_explain(folders: Sequence[Path]) -> list[Path]:
    """Return the findings of a campaign to take through the chain: not those of the group of malformed payloads."""
    return [folder for folder in folders if not FindingRecord.load(folder).malformed]


def with_other_causes(folders: Sequence[Path]) -> Iterator[tuple[Path, int]]:
    """Yield findings, and those with another cause of the same failure that analyzing them has added meanwhile.

    Each comes with the number of findings that are left, itself included.
    """
    queue = list(folders)
    for number, folder in enumerate(queue):
        yield folder, len(queue) - number
        other = other_cause(folder)
        if FindingRecord.exists(other) and other not in queue:
            queue.append(other)


def analyze(
    workspace: Workspace,
    folder: Path,
    *,
    further: Sequence[ChainStep] = (),
    options: Options | None = None,
    left: Callable[[], float] | None = None,
) -> Analysis:
    """Take a finding through all steps; one that cannot go on ends the chain, but the report is always written.

    Raises:
        ConfigError: `finding.json` or the file of a finished step cannot be used.
    """
    FindingRecord.load(folder)
    outside = bool(workspace.context.file.external.topics)
    stopped, unfinished, open_questions = "", False, list[str]()
    steps = [step for step in (*STEPS[1:], *further) if outside or not step.whole_system or step.kind.exists(folder)]
    for number, step in enumerate(steps):
        if step.kind.exists(folder):
            step.kind.load(folder)
            continue
        rest = [each for each in steps[number:] if not each.kind.exists(folder)]
        limits = {} if left is None else budget_within(workspace, folder, rest, left())
        try:
            workspace.carry_out(step, folder, **limits | dict((options or {}).get(step.name, {})))
        except (InconclusiveError, OutOfTimeError, PayloadError) as error:
            stopped, unfinished = str(error), isinstance(error, OutOfTimeError)
            workspace.tell(StepStopped(step.name, stopped, str(folder)))
            open_questions.append(f"The step `{step.name}` ended early: {stopped}")
            break
    report = write_report(folder, open_questions=open_questions)
    workspace.tell(AnalysisFinished(str(folder), str(report), stopped))
    return Analysis(folder, report, stopped, unfinished)


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
