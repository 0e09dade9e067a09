"""Step `test`: a campaign on one unit, its failures grouped into findings (RIOT II-A)."""

from __future__ import annotations

import itertools
import logging
from collections import Counter
from dataclasses import asdict
from typing import TYPE_CHECKING

from riot_bus.campaign.campaign import CampaignResult, run_campaign
from riot_bus.campaign.covering import Covering, failure_rates
from riot_bus.campaign.groups import groups_of
from riot_bus.campaign.malformed import malformations
from riot_bus.campaign.observed import with_observed
from riot_bus.campaign.schedule import Schedule, message_faults, positions_of
from riot_bus.campaign.targets import targets_of
from riot_bus.campaign.triage import Failure, finding_id, severity
from riot_bus.chain.histories import shrink_history
from riot_bus.chain.logs import FailingLog
from riot_bus.chain.questions import dictionary_of
from riot_bus.events import CampaignFinished, FindingWritten
from riot_bus.findings.records import (
    CampaignRecord,
    EffectsRecord,
    FindingRecord,
    MinimalRecord,
    ProportionRecord,
    UnconfirmedRecord,
)
from riot_bus.inject.apply import inject_log
from riot_bus.report.finding_view import EVIDENCE
from riot_bus.report.format import clean
from riot_bus.report.reproduce import write_reproduce
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.counting import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.campaign.covering import Variation
    from riot_bus.chain.workspace import StepRun, Workspace
    from riot_bus.statistics.rates import Proportion
    from riot_bus.sut.baseline import Baseline
    from riot_bus.vocabulary.message import Message

__all__ = ["test_unit", "tested"]

_LOG = logging.getLogger(__name__)
_MOST_HISTORIES = 5
"""Each may take some hundred trials."""


def test_unit(workspace: Workspace, unit: str, *, trials: int, seconds: float | None, covered: bool) -> list[Path]:
    """Run a campaign and write one folder per finding, the worst first, then those that come easily.

    Args:
        workspace: Where to work.
        unit: The unit to test.
        trials: At most so many injected trials.
        seconds: At most so much time; None for no limit.
        covered: Whether to end when all that there is to try was tried.

    Raises:
        RiotError: The unit does not start, its log holds nothing for it, or nothing can be injected.
    """
    registry = workspace.context.registry
    settings = workspace.context.file.unit[unit]
    log = workspace.unit_log(unit)
    dictionary = dictionary_of(workspace, unit)
    everything = targets_of(log, registry, include=["*"])
    for problem in dictionary.unmatched(f"{each.topic}:{each.path}" for found in everything.values() for each in found):
        _LOG.warning("riot: %s", problem)
    targets = targets_of(log, registry, leave=settings.leave, include=settings.include)
    schedule = Schedule(
        with_observed(targets, log, registry),
        dictionary,
        seed=workspace.seed,
        groups=groups_of(log, registry, dictionary, leave=settings.leave, include=settings.include),
    )

    with workspace.step("test") as step:
        baseline = workspace.runners.baseline(unit, lambda: log)
        result = run_campaign(
            log,
            schedule,
            step.unit_runner(unit),
            seed=workspace.seed,
            trials=trials,
            covering=Covering(
                [
                    *schedule.items(),
                    *message_faults(log, registry, leave=settings.leave),
                    *malformations(log, registry, leave=settings.leave, include=settings.include),
                ],
                positions_of(log, registry),
                seed=workspace.seed,
            ),
            ordered=baseline.ordered,
            seconds=seconds,
            covered=covered,
            progress=step.progress,
            found=lambda failure: _save(step, unit, failure, log),
            explorer=step.unit_runner(unit, persistent=True) if settings.isolation == "persistent" else None,
        )
        saved = [_save(step, unit, failure, log) for failure in result.failures.values()]
        traced, untraced = _after_others(step, unit, result, baseline)
        saved += [_save(step, unit, failure, failure.case.messages) for failure in traced]
        folders = sorted(saved, key=lambda folder: FindingRecord.load(folder).rank)
        types = {(each.topic, each.path): each.type for found in everything.values() for each in found}
        record = CampaignRecord(
            unit=unit,
            fingerprint=workspace.fingerprint,
            failing=result.failing,
            tested=result.trials,
            findings=tuple(folder.name for folder in folders),
            unconfirmed=(*map(_unconfirmed, result.unconfirmed.values()), *untraced),
            notes=dict(result.notes),
            ordered=baseline.ordered,
            started=result.started,
            covered=len(result.tried),
            coverable=result.coverable,
            effects=_effects(result, types),
            untold=baseline.untold,
            rate=_rate(proportion(result.failing, result.trials)),
            mined=baseline.mined.row(),
            seed=workspace.seed,
            trials=step.trials,
            seconds=step.seconds,
        )
        record.save(workspace.out)
        found = map(_told, [*result.failures.values(), *traced])
        after = [_after(each) for each in untraced]
        lines = [*found, *after, *record.effects.lines(), *(f"not told: {one}" for one in record.untold)]
        step.end("\n".join([_summary(unit, log, result), *lines]), folder=workspace.out, record=record)
        names = tuple(map(str, folders))
        workspace.tell(
            CampaignFinished(unit, result.trials, result.failing, result.exhausted, names, seconds=step.seconds)
        )
    return folders


def tested(workspace: Workspace, unit: str) -> list[Path] | None:
    """Return the findings of a finished campaign on this very system, unit and seed; None if there was none."""
    if not CampaignRecord.exists(workspace.out):
        return None
    record = CampaignRecord.load(workspace.out)
    if (record.unit, record.fingerprint, record.seed) != (unit, workspace.fingerprint, workspace.seed):
        return None
    return [workspace.findings / name for name in record.findings]


def _after_others(
    step: StepRun, unit: str, result: CampaignResult, baseline: Baseline
) -> tuple[list[Failure], list[UnconfirmedRecord]]:
    """Look for logs with which a fresh process fails as one did after other cases; return these, and what has none."""
    traced, untraced = [], []
    if result.after_others:
        runner, registry = step.unit_runner(unit), step.workspace.context.registry
    for number, each in enumerate(sorted(result.after_others.values(), key=lambda each: len(each.before))):
        shrunk = None
        if number < _MOST_HISTORIES:
            shrunk = shrink_history(each, runner, registry=registry, probe=baseline.probe, progress=step.progress)
        if shrunk is not None:
            traced.append(shrunk)
            continue
        untraced.append(
            UnconfirmedRecord(
                signature=each.violation.signature,
                details=(each.violation.detail,),
                occurrences=each.occurrences,
                repeats=1,
                history=len(each.before),
                injections=tuple(one.row() for one in each.case.injections),
            )
        )
    return traced, untraced


def _unconfirmed(failure: Failure) -> UnconfirmedRecord:
    repeats = failure.rate.total if failure.rate else 0
    return UnconfirmedRecord(
        signature=failure.violation.signature,
        details=tuple(failure.details),
        occurrences=failure.occurrences,
        repeats=repeats,
        injections=tuple(each.row() for each in failure.case.injections),
    )


def _after(each: UnconfirmedRecord) -> str:
    cases = counted(each.history, "other test case")
    return f"not confirmed: {clean(each.signature, limit=160)}: seen after {cases} in one process, not in a fresh one"


def _summary(unit: str, log: Sequence[Message], result: CampaignResult) -> str:
    text = (
        f"{counted(result.trials, 'trial')} of {unit} with {counted(len(log), 'message')} each: "
        f"{result.failing} failed, {counted(len(result.failures), 'distinct finding')}"
    )
    if result.coverable:
        text += f"; {len(result.tried)} of {result.coverable} values and message faults tried"
    if result.unconfirmed:
        repeats = sum(each.rate.total if each.rate else 0 for each in result.unconfirmed.values())
        hits = sum(each.rate.hits if each.rate else 0 for each in result.unconfirmed.values())
        again = f"came again in {hits} of" if hits else "did not come again in"
        text += f"; {len(result.unconfirmed)} more {again} {counted(repeats, 'fresh trial')}"
        text += ", which may be chance" if hits else ""
    if result.notes:
        text += f"; monitors that did not judge: {'; '.join(result.notes)[:500]}"
    return text


def _told(failure: Failure) -> str:
    rate = f" ({failure.rate.hits} of {counted(failure.rate.total, 'fresh trial')})" if failure.rate else ""
    return f"found {clean(failure.violation.signature, limit=160)}{rate}"


def _save(step: StepRun, unit: str, failure: Failure, log: Sequence[Message]) -> Path:
    """Write a finding; of one that is there already, only how often it was seen: its rate is that of the log it keeps.

    Nothing is deleted.
    """
    workspace = step.workspace
    name = finding_id(failure.violation)
    folder = workspace.findings / name
    known = FindingRecord.load(folder) if FindingRecord.exists(folder) else None
    told = known is None
    if known is not None and known.fingerprint not in ("", workspace.fingerprint):
        _put_aside(folder, known.fingerprint)
        known, told = None, True
    elif known is not None and failure.modified < known.modified and not MinimalRecord.exists(folder):
        known = None  # a simpler case has been found since
    if known is None:
        record = _write(step, unit, failure, log, folder)
    else:
        record = known.model_copy(
            update={
                "occurrences": max(known.occurrences, failure.occurrences),
                "details": tuple(dict.fromkeys([*known.details, *failure.details])),
                "trials": step.trials,
                "seconds": step.seconds,
            }
        )
    record.save(folder)
    write_reproduce(folder)
    if not (folder / EVIDENCE).is_dir():
        workspace.runners.keep_evidence(unit, failure.case, failure.violation.signature, folder / EVIDENCE)
    if told:
        workspace.tell(
            FindingWritten(step.name, str(folder), name, failure.violation.signature, occurrences=failure.occurrences)
        )
    return folder


def _put_aside(folder: Path, fingerprint: str) -> None:
    """Move what was learnt of a finding in another version of the system into a folder of its own.

    `finding.json` goes last: as long as it is there, what was cut off is done again.
    """
    names = itertools.chain([fingerprint], (f"{fingerprint}-{number}" for number in itertools.count(2)))
    target = next(path for name in names if not FindingRecord.exists(path := folder / "earlier" / name))
    target.mkdir(parents=True, exist_ok=True)
    for path in sorted(folder.iterdir(), key=lambda path: path.name == FindingRecord.FILE):
        if path.name != "earlier":
            path.replace(target / path.name)


def _rate(rate: Proportion | None) -> ProportionRecord | None:
    if rate is None:
        return None
    return ProportionRecord(value=rate.rate, low=rate.low, high=rate.high, count=rate.hits, total=rate.total)


def _effects(result: CampaignResult, types: Mapping[tuple[str, str], str]) -> EffectsRecord:
    """Return what injections did; `types` are the types of fields, by topic and path."""

    def class_of(item: Variation) -> str:
        first = item.injections[0]
        if len(item.injections) > 1 or first.field is None:
            return first.fault if first.field is None else "several fields"
        return types.get((item.topic, first.field), "other")

    rates = {
        "topics": failure_rates(result.tried, lambda item: item.topic),
        "classes": failure_rates(result.tried, class_of),
    }
    found = {name: {key: _rate(rate) for key, rate in each.items()} for name, each in rates.items()}
    undecided = Counter(item.topic for item in result.undecided)
    return EffectsRecord.model_validate(asdict(result.effects) | found | {"undecided": undecided})


def _write(step: StepRun, unit: str, failure: Failure, log: Sequence[Message], folder: Path) -> FindingRecord:
    workspace, injections = step.workspace, failure.case.injections
    context = workspace.context
    numbered = [message.with_(sequence=number) for number, message in enumerate(log)]
    delivered, touched = inject_log(numbered, injections, registry=context.registry, seed=workspace.seed)
    prefix = delivered[: failure.played] if failure.played else delivered
    numbers = {message.sequence for message in prefix}
    originals = {original.sequence: original for _, original, _ in touched if original.sequence in numbers}
    changes = {original.sequence: made for _, original, made in touched}
    folder.mkdir(parents=True, exist_ok=True)
    metadata = {"finding": folder.name, "signature": failure.violation.signature, "seed": str(workspace.seed)}
    FailingLog(prefix, originals).save(folder / "failure.mcap", context=context, metadata=metadata, changes=changes)
    return FindingRecord(
        id=folder.name,
        system=context.file.system.name,
        system_file=str(context.file.path),
        fingerprint=workspace.fingerprint,
        unit=unit,
        component=failure.violation.component,
        monitor=failure.violation.monitor,
        severity=severity(failure.violation),
        signature=failure.violation.signature,
        details=tuple(failure.details),
        occurrences=failure.occurrences,
        rate=_rate(failure.rate),
        nominal=_rate(failure.nominal),
        ordered=failure.case.ordered,
        injections=tuple(injection.row() for injection in injections),
        delivered=tuple(failure.outcome.statistics.get("delivered", ())),
        messages=len(prefix),
        modified=len(originals),
        external=bool(context.file.external.topics),
        seed=workspace.seed,
        trials=step.trials,
        seconds=step.seconds,
    )
