"""Replays of a finding: fresh trials of its shortest log, never from the store, tell whether it still fails."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from riot_bus.chain.base.external import driving_log, parameter_name
from riot_bus.chain.base.logs import FailingLog
from riot_bus.chain.base.workspace import NOMINAL, StepRun, Workspace
from riot_bus.chain.unit.questions import noise_of
from riot_bus.findings.activation import ActivationRecord
from riot_bus.findings.records import FindingRecord, MinimalRecord, shortest_log
from riot_bus.log.reader import read_log
from riot_bus.monitors.model import Monitor, names_of
from riot_bus.plugins import MONITORS
from riot_bus.pool.nominal import needs_baseline, why_not_told
from riot_bus.statistics.noise import Noise
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, InconclusiveError
from riot_bus.vocabulary.injection import PARAMETERS, Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Runner, TestCase, Verdict, Violation

_DOUBT = 0.05
"""Accepted doubt about the answer."""
_NO_LOG = "there is no nominal log"
_COUNTED = re.compile(r" \(\d+\)$")
"""Suffix that distinguishes monitors of the same name."""


Answer = Literal["still failing", "fixed", "failing otherwise", "not decided"]


@dataclass(frozen=True, slots=True)
class Reproduction:
    """The answer: how many of the fresh trials showed the same failure again.

    Attributes:
        answer: `failing otherwise`: every trial failed, all in the same way, but none as before.
        missed: For `fixed`: the probability that no trial would have failed if the failure still had its former rate.
    """

    answer: Answer
    failed: int
    trials: int
    log: str
    detail: str = ""
    missed: float = 0.0
    others: tuple[Violation, ...] = ()
    expected: float = 1.0


def reproduce(
    workspace: Workspace, folder: Path, *, times: int | None = None, whole_system: bool = False
) -> Reproduction:
    """Answer whether a finding's log still fails, or say why that is not decided; see `play_again`.

    Raises:
        InconclusiveError: The trials do not decide, or show another failure; or runs of the whole system cannot tell.
        ConfigError: There is no log to play.
        EnvironmentFaultError: The components do not start.
    """
    found = play_again(workspace, folder, times=times, whole_system=whole_system)
    if found.answer in ("still failing", "fixed"):
        return found
    others = ", ".join(each.signature for each in found.others)
    raise InconclusiveError(
        f"{found.failed} of {counted(found.trials, 'trial')} of {found.log} fail as before"
        + (f", others fail differently: {others}" if others else f", where about {found.expected:.0%} did"),
        hint="repeat with more --times for a clearer picture",
    )


def play_again(
    workspace: Workspace, folder: Path, *, times: int | None = None, whole_system: bool = False
) -> Reproduction:
    """Play a finding's log to fresh components until it is decided whether it fails as often as before, or not at all.

    Raises:
        InconclusiveError: Runs of the whole system or nominal trials of the unit cannot tell, or the monitor that found
            the failure had nothing to judge.
        ConfigError: There is no log to play.
        EnvironmentFaultError: The components do not start.
    """
    finding, untold, unprobed = FindingRecord.load(folder), "", False
    registry = workspace.context.registry
    whole_system = whole_system or finding.whole_system
    if whole_system:
        path = folder / ("failure.mcap" if finding.whole_system else "activation.mcap")
        if not path.is_file() or not (finding.whole_system or ActivationRecord.exists(folder)):
            step = "riot test --whole-system" if finding.whole_system else "riot activate"
            raise ConfigError(f"no {path.name}", where=str(folder), hint=f"run `{step}` first")
        messages = read_log(path)
        activation = None if finding.whole_system else ActivationRecord.load(folder)
        parameters = _parameters(activation, workspace) if activation else ()
        pace = workspace.context.file.system.trial_run
        judged, why = workspace.judged_in_system(finding, driving_log(workspace, pace))
        if why:
            raise InconclusiveError(f"not tested in the whole system: {why}", where=str(folder))
        runner, monitors = workspace.runners.system(pace, judged=judged), workspace.context.monitors
        replayed = (activation.replays_failed, activation.replays) if activation else (0, 0)
        noise = Noise.after(*replayed) if replayed[0] else noise_of(finding)
    else:
        path = shortest_log(folder)
        messages, parameters = FailingLog.load(path, registry=registry).messages, ()
        nominal = workspace.known_unit_log(finding.unit)
        runner = workspace.runners.unit(finding.unit, lambda: nominal)
        monitors = workspace.context.monitors_of(workspace.context.file.component_of(finding.unit))
        of = {"unit": finding.unit, "monitor": finding.monitor, "signature": finding.signature}
        untold = why_untold(workspace, **of, nominal=nominal)
        if untold and finding.monitor != "hang":  # if it occurs again, it may show in other ways
            raise _undetectable(workspace, finding, folder, untold)
        minimal = MinimalRecord.find(folder)
        noise, unprobed = noise_of(finding, minimal), minimal is not None and minimal.unprobed
    ordered = finding.ordered and not whole_system
    most = times or (20 if whole_system else 60)
    case = TestCase(messages, parameters, ordered=ordered, unprobed=unprobed)
    cases = [replace(case, seed=workspace.seed + number) for number in range(most)]
    outcomes = _outcomes(workspace, runner, cases, finding.signature, noise, all_of_them=times is not None)
    failed = sum(outcome.failed_as(finding.signature) for outcome in outcomes)
    first = (outcome.violations[0] for outcome in outcomes if outcome.verdict is Verdict.FAIL)
    ways = {each.signature: each for each in first}
    others = tuple(ways[name] for name in sorted(ways.keys() - {finding.signature}))
    still = noise.triggers(failed, len(outcomes) - failed)
    found = Reproduction("not decided", failed, len(outcomes), path.name, others=others, expected=noise.rate)
    if still > 1 - _DOUBT:
        same = next(filter(None, (one.violation_as(finding.signature) for one in outcomes)))
        return replace(found, answer="still failing", detail=same.detail)
    if failed or still >= _DOUBT:
        return found
    if not others:
        if untold := untold or _why_blind(monitors, finding, outcomes):
            raise _undetectable(workspace, finding, folder, untold)
        return replace(found, answer="fixed", missed=noise.missed(len(outcomes)))
    every = all(outcome.verdict is Verdict.FAIL for outcome in outcomes)
    return replace(found, answer="failing otherwise" if every and len(others) == 1 else "not decided")


def _undetectable(workspace: Workspace, finding: FindingRecord, folder: Path, why: str) -> InconclusiveError:
    """Return the error for passing trials that prove nothing about a failure."""
    log = workspace.out / NOMINAL
    return InconclusiveError(
        f"nothing here shows whether {finding.monitor!r} occurs: {why}",
        where=str(folder),
        hint=f"name one in riot.toml, or put the campaign's at {log}" if why == _NO_LOG else None,
    )


def why_untold(workspace: Workspace, *, unit: str, monitor: str, signature: str, nominal: Sequence[Message]) -> str:
    """Return why a comparison with nominal trials cannot show a failure; empty if it can, or is not needed.

    A hang without a place means that the unit never came to rest, or took no messages: that shows in any trial.

    Args:
        nominal: The unit's nominal log, empty if there is none.
    """
    place = signature.partition(": ")[2]
    if not needs_baseline(monitor) or (monitor == "hang" and not place):
        return ""
    if not nominal:
        return _NO_LOG
    baseline = workspace.runners.baseline(unit, lambda: nominal)
    if monitor == "silent" and baseline.trials:
        topics = place.removeprefix("nothing on ").split(", ")
        known = baseline.probe_answers.keys() & set(topics)
        return "" if known else f"in nominal trials the unit does not answer nominal input on {', '.join(topics)}"
    return why_not_told(baseline, monitor, signature).replace("runs of the whole system", "trials")


def _why_blind(monitors: Sequence[Monitor], finding: FindingRecord, outcomes: Sequence[Outcome]) -> str:
    """Return why no monitor of riot.toml could detect a failure in any trial; empty if one could, or none is needed.

    What a monitor of another package names is unknown. A `log` monitor reads what is always there.
    """
    if needs_baseline(finding.monitor) or finding.monitor in ("crash", "limit", "log"):
        return ""
    text = f" {finding.signature} {finding.component} ".replace(",", " ")
    target = MONITORS.targets().get(finding.monitor, "")
    own = target.rpartition(":")[2] if target.startswith("riot_bus.monitors.") else ""
    names = []
    for name in names_of(monitors):
        kind, _, where = _COUNTED.sub("", name).partition(" ")
        parts = [f" {part.replace(',', ' ')}" for part in where.split(", ") if part]
        if own in ("", kind) and any(f"{part}{end}" in text for part in parts for end in " :"):
            names.append(name)
    if not names:
        return f"riot.toml has no such monitor of {finding.component} any more" if own else ""
    reasons = [_why_not_judged(name, outcome) for outcome in outcomes for name in names]
    return f"{names[-1]}: {reasons[-1]}" if all(reasons) else ""


def _why_not_judged(name: str, outcome: Outcome) -> str:
    """Return why a monitor did not judge a trial (it saw nothing, or failed itself); empty if it did."""
    lines = [*map(str, outcome.statistics.get("unseen", ())), *outcome.detail.split("; ")]
    return next((line.removeprefix(f"{name}: ") for line in lines if line.startswith(f"{name}: ")), "")


def _parameters(record: ActivationRecord, workspace: Workspace) -> tuple[Injection, ...]:
    """Return the parameters of commands with which the external messages made the whole system fail."""
    found = record.found or {}
    names = workspace.context.file.external.parameters
    return tuple(
        Injection(PARAMETERS, one, found[parameter_name(one)]) for one in names if parameter_name(one) in found
    )


def _outcomes(
    workspace: Workspace, runner: Runner, cases: list[TestCase], signature: str, noise: Noise, *, all_of_them: bool
) -> list[Outcome]:
    """Run cases until they decide the answer, or all of them, and return their outcomes."""
    outcomes: list[Outcome] = []
    while len(outcomes) < len(cases):
        count = len(cases) if all_of_them else runner.parallelism if outcomes else 3
        for outcome in runner.run(cases[len(outcomes) : len(outcomes) + count]):
            StepRun(workspace, "reproduce").told(outcome)
            if not outcome.judged:
                raise EnvironmentFaultError(outcome.detail)
            outcomes.append(outcome)
        failed = sum(outcome.failed_as(signature) for outcome in outcomes)
        still = noise.triggers(failed, len(outcomes) - failed)
        if not _DOUBT <= still <= 1 - _DOUBT:
            break
    return outcomes
