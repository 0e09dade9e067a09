"""Step `test`: a campaign on one unit, its failures grouped into findings (RIOT II-A)."""

from __future__ import annotations

import itertools
import logging
import math
import shutil
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from riot_bus.campaign.bindings import naming_nothing, never_applied
from riot_bus.campaign.campaign import CampaignResult, CampaignSettings, run_campaign
from riot_bus.campaign.covering import Covering, failure_rates
from riot_bus.campaign.groups import groups_of
from riot_bus.campaign.malformed import fixed_lengths, malformations
from riot_bus.campaign.schedule import Schedule, message_faults, positions_of
from riot_bus.campaign.store import StoredRunner
from riot_bus.campaign.targets import targets_of, with_observed
from riot_bus.campaign.triage import FIXED, Failure, Types, complexity, finding_id, severity
from riot_bus.campaign.variations import Variation
from riot_bus.chain.base.external import driving_log, system_log
from riot_bus.chain.base.injections import injection_of
from riot_bus.chain.base.logs import FailingLog
from riot_bus.chain.base.workspace import StepRun, Workspace
from riot_bus.chain.unit.leaks import find_leak
from riot_bus.chain.unit.questions import dictionary_of
from riot_bus.events import CampaignFinished, CampaignStarted
from riot_bus.findings.records import (
    CampaignRecord,
    EffectsRecord,
    FindingRecord,
    MinimalRecord,
    ProportionRecord,
    UnconfirmedRecord,
    UnjudgedRecord,
)
from riot_bus.inject.apply import inject_log
from riot_bus.log.reader import read_log
from riot_bus.report.finding_view import EVIDENCE
from riot_bus.report.format import clean
from riot_bus.statistics.rates import Proportion, proportion
from riot_bus.trial.baseline import Baseline
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, Runner, TestCase

_LOG = logging.getLogger(__name__)
_TRIES, _MOST_TRIES, _MISSED = 5, 30, 0.05
"""Trials for evidence in one call of a runner, trials in all at most, and the accepted probability that none fails."""


@dataclass(frozen=True, slots=True)
class _Subject:
    """The subject of a campaign: a unit with its nominal log, or the running system with its external messages."""

    unit: str
    name: str
    log: tuple[Message, ...]
    leave: Sequence[str]
    include: Sequence[str]
    malformed: str = "group"
    whole_system: bool = False


def _subject(workspace: Workspace, unit: str, *, whole_system: bool) -> _Subject:
    file = workspace.context.file
    if whole_system:
        if not any(component.external for component in file.components.values()):
            raise ConfigError(
                "no component is external, so nothing drives the system, and nothing of it can be changed",
                where=f"{file.path}: [components]",
                hint="leave --whole-system out; permeability and activate change the nominal log where that drives it",
            )
        return _Subject(unit, file.system.name, system_log(workspace), file.external.exclude, (), whole_system=True)
    settings = file.unit[unit]
    log = workspace.unit_log(unit)
    return _Subject(unit, unit, log, settings.leave, settings.include, malformed=settings.malformed)


def test_unit(
    workspace: Workspace,
    unit: str,
    *,
    trials: int | None,
    seconds: float | None,
    covered: bool,
    whole_system: bool = False,  # noqa: PT028 - it is not a test
    stop: Callable[[Sequence[Path]], str] = lambda _: "",  # noqa: PT028
) -> list[Path]:
    """Run a campaign and write one folder per finding, the worst first, then those that occur easily.

    Args:
        whole_system: Whether trials are runs of the whole system with injections into the external messages, instead of
            a log that is played to the unit; they show less about the other components than about the unit.
        stop: Function of the findings so far that returns why to run no further injected trials; empty to continue.

    Raises:
        RiotError: The unit does not start, its log holds nothing for it, nothing can be injected, or one of its
            own dictionaries has an entry that can never apply.
    """
    workspace.tell(CampaignStarted(unit, workspace.fingerprint))
    subject = _subject(workspace, unit, whole_system=whole_system)
    schedule, types = _planned(workspace, subject)
    with workspace.step("test") as step:
        runner, baseline, untold = _judge_of(step, subject)
        written: list[Path] = []
        result = run_campaign(
            () if whole_system else subject.log,
            schedule,
            runner,
            CampaignSettings(
                seed=workspace.seed, trials=trials, ordered=baseline.ordered, seconds=seconds, covered=covered
            ),
            covering=_covering(workspace, subject, schedule),
            progress=step.progress,
            found=lambda failure: written.append(_save(step, subject, failure, baseline)),
            stop=lambda: bool(stop(written)),
        )
        untold += _unknown(runner, result)
        saved = [_save(step, subject, failure, baseline) for failure in result.failures.values()]
        leaks, normal = _leaks(step, subject, result, types)
        untold += normal
        saved += [_save(step, replace(subject, log=each.case.messages), each, baseline) for each in leaks]
        folders = sorted(saved, key=lambda folder: FindingRecord.load(folder).rank)
        bare = (FindingRecord.load(folder) for folder in folders if not (folder / EVIDENCE).is_dir())
        untold += tuple(f"what {one.signature} leaves: no trial that was to leave evidence failed so" for one in bare)
        figures = {"untold": untold, "stopped": stop(written) if result.stopped else ""}
        record = _campaign_record(step, subject, result, baseline, folders, types).model_copy(update=figures)
        record.save(workspace.out)
        found = map(_told, [*result.failures.values(), *leaks])
        doubts = [*map(str, record.unjudged), *record.effects.lines(), *(f"not told: {one}" for one in record.untold)]
        starts = "; ".join(f"{how} in {counted(count, 'trial')}" for how, count in result.starts.items())
        lines = [*found, *doubts, *([f"how the unit was started: {starts}"] if starts else [])]
        step.end(
            "\n".join([_summary(subject, result, folders, record.stopped), *lines]),
            folder=workspace.out,
            record=record,
        )
        names = tuple(map(str, folders))
        workspace.tell(
            CampaignFinished(unit, result.trials, result.failing, result.exhausted, names, seconds=step.seconds)
        )
    return folders


def _planned(workspace: Workspace, subject: _Subject) -> tuple[Schedule, Types]:
    """Return what is tried, and the types of all fields by topic and path."""
    registry = workspace.context.registry
    log, leave, include = subject.log, subject.leave, subject.include
    dictionary = dictionary_of(workspace, subject.unit)
    everything = targets_of(log, registry, include=["*"])
    for problem in never_applied(dictionary, log, registry, everything):
        if not subject.whole_system:
            raise problem
        _LOG.warning("riot: %s", problem)
    for pattern in naming_nothing((*leave, *include), everything):
        _LOG.warning("riot: %s: %r of leave or include names no field of the log", subject.name, pattern)
    schedule = Schedule(
        with_observed(targets_of(log, registry, leave=leave, include=include), log, registry),
        dictionary,
        seed=workspace.seed,
        groups=groups_of(log, registry, dictionary, leave=leave, include=include),
    )
    fixed = dict.fromkeys(fixed_lengths(log, registry), FIXED)
    schedule.types |= fixed
    return schedule, fixed | {(each.topic, each.path): each.type for found in everything.values() for each in found}


def _covering(workspace: Workspace, subject: _Subject, schedule: Schedule) -> Covering:
    log, registry = subject.log, workspace.context.registry
    return Covering(
        [
            *schedule.items(),
            *message_faults(log, registry, leave=subject.leave),
            *(
                each
                for each in malformations(log, registry, leave=subject.leave, include=subject.include)
                if subject.malformed != "never" or not each.malformed
            ),
        ],
        positions_of(log, registry),
        seed=workspace.seed,
    )


def _unknown(runner: Runner, result: CampaignResult) -> tuple[str, ...]:
    """Return what the trials of a campaign leave unknown."""
    untold: list[str] = []
    if isinstance(runner, _Inside):
        failed = (f"{signature} ({counted(number, 'run')})" for signature, number in runner.failed.items())
        untold += (f"whether the system made what drives it fail: {each}" for each in failed)
    if result.unordered:
        of = f"{result.unordered} of {counted(result.trials, 'trial')}"
        untold.append(f"what depends on the order across topics: it could not be kept in {of}")
    if result.calm:
        of = f"for {result.calm} of {counted(result.trials, 'trial')}, since hangs took more than half of the time"
        untold.append(f"whether more values hang: those of fields that hung already were kept back {of}")
    return tuple(untold)


def _campaign_record(
    step: StepRun,
    subject: _Subject,
    result: CampaignResult,
    baseline: Baseline,
    folders: Sequence[Path],
    types: Types,
) -> CampaignRecord:
    workspace, tested = step.workspace, result.trials - len(result.unjudged)
    return CampaignRecord(
        unit=subject.unit,
        fingerprint=workspace.fingerprint,
        failing=result.failing,
        tested=tested,
        findings=tuple(folder.name for folder in folders),
        unconfirmed=tuple(map(_unconfirmed, result.unconfirmed.values())),
        unjudged=_unjudged(result.unjudged),
        notes=dict(result.notes),
        ordered=baseline.ordered,
        started=["", *result.starts][-1],
        covered=len(result.tried),
        coverable=result.coverable,
        effects=_effects(result, types),
        whole_system=subject.whole_system,
        rate=_rate(proportion(result.failing, tested)),
        mined=baseline.mined.row(),
        system_file=str(workspace.context.file.path),
        seed=workspace.seed,
        trials=step.trials,
        seconds=step.seconds,
    )


def tested(workspace: Workspace, unit: str) -> list[Path] | None:
    """Return the findings of a finished campaign on this very system, unit and seed; None if there was none."""
    record = CampaignRecord.find(workspace.out)
    same = (unit, workspace.fingerprint, workspace.seed, False)
    if record is None or (record.unit, record.fingerprint, record.seed, record.whole_system) != same:
        return None
    return [workspace.findings / name for name in record.findings]


def _leaks(
    step: StepRun, subject: _Subject, result: CampaignResult, types: Types
) -> tuple[list[Failure], tuple[str, ...]]:
    """Return growth that shows when a log is repeated, and what that cannot tell."""
    known = {*result.failures, *result.unconfirmed, *result.alarms}
    if subject.whole_system or result.stopped or any(name.startswith("growth") for name in known):
        return [], ()
    runner, registry = step.unit_runner(subject.unit, unjudged=True), step.workspace.context.registry
    for grown, case in result.grown[:5]:  # each may take as long as 64 trials
        leak = find_leak(grown, case, runner, registry=registry, types=types, progress=step.progress)
        if leak.failure is not None:
            return [leak.failure], ()
        if leak.nominal is not None:
            return [], (f"whether inputs make it grow: nominal ones do, {leak.nominal.detail}",)
    return [], ()


def _unconfirmed(failure: Failure) -> UnconfirmedRecord:
    hits, repeats = (failure.rate.hits, failure.rate.total) if failure.rate else (0, 0)
    return UnconfirmedRecord(
        signature=failure.violation.signature,
        details=tuple(failure.details),
        occurrences=failure.occurrences,
        hits=hits,
        repeats=repeats,
        injections=tuple(each.row() for each in failure.case.injections),
    )


def _unjudged(cases: Sequence[tuple[TestCase, str]]) -> tuple[UnjudgedRecord, ...]:
    """Return the cases that could not be judged, by reason."""
    reasons: dict[str, list[Sequence[Injection]]] = {}
    for case, reason in cases:
        reasons.setdefault(reason, []).append(case.injections)
    return tuple(
        UnjudgedRecord(detail=reason, occurrences=len(each), injections=tuple(one.row() for one in min(each, key=len)))
        for reason, each in reasons.items()
    )


def _summary(subject: _Subject, result: CampaignResult, folders: Sequence[Path], why: str) -> str:
    places = sum(FindingRecord.load(folder).malformed for folder in folders)
    messages = counted(len(subject.log), "message")
    what, each = ("run", f"about {messages} from outside") if subject.whole_system else ("trial", f"{messages} each")
    text = (
        f"{counted(result.trials, what)} of {subject.name} with {each}: "
        f"{result.failing} failed, {counted(len(folders) - places, 'distinct finding')}"
    )
    if places:
        text += f"; payloads are not checked in {counted(places, 'place')}"
    if result.coverable:
        text += f"; {len(result.tried)} of {result.coverable} values and message faults tried"
    if result.unconfirmed:
        rates = [each.rate for each in result.unconfirmed.values() if each.rate]
        repeats, hits = sum(one.total for one in rates), sum(one.hits for one in rates)
        again = f"came again in {hits} of" if hits else "did not come again in"
        text += f"; {len(result.unconfirmed)} more {again} {counted(repeats, 'fresh trial')}"
        text += ", which may be chance" if hits else ""
    if result.stopped:
        text += f"; ended early: {why}"
    if result.notes:
        text += f"; monitors that did not judge: {'; '.join(result.notes)[:500]}"
    return text


def _told(failure: Failure) -> str:
    rate = f" ({failure.rate.hits} of {counted(failure.rate.total, 'fresh trial')})" if failure.rate else ""
    return f"found {clean(failure.violation.signature, limit=160)}{rate}"


class _Inside:
    """A runner whose outcomes leave out failures of external components, which drive the system and are not tested.

    Failures that nominal runs of the whole system, judged in the same way, have shown are left out, too.

    Attributes:
        failed: Signatures of external components that were left out, with the number of runs.
    """

    def __init__(self, runner: StoredRunner, external: Collection[str], alarms: Collection[str]) -> None:
        self._runner, self._external, self._alarms = runner, external, alarms
        self.failed = Counter[str]()

    @property
    def parallelism(self) -> int:
        """How many run at once."""
        return self._runner.parallelism

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Return the outcomes of all cases."""
        return [self._judge(outcome) for outcome in self._runner.run(cases)]

    def _judge(self, outcome: Outcome) -> Outcome:
        self.failed.update({each.signature for each in outcome.violations if each.component in self._external})
        return outcome.without(lambda each: each.component in self._external or each.signature in self._alarms)


def _judge_of(step: StepRun, subject: _Subject) -> tuple[StoredRunner | _Inside, Baseline, tuple[str, ...]]:
    """Return the runner of trials, the baseline they are compared with, and what they cannot show."""
    workspace, unit = step.workspace, subject.unit
    if not subject.whole_system:
        baseline = workspace.runners.baseline(unit, lambda: subject.log)
        return step.unit_runner(unit, unjudged=True), baseline, baseline.untold
    pace = workspace.context.file.system.trial_run
    driving = driving_log(workspace, pace)
    baseline = workspace.runners.in_system(unit, lambda: workspace.unit_log(unit), pace, driving)
    judged = (unit, baseline) if baseline.trials else None
    others = f"of components other than {unit}: whether they fall silent, hang or grow"
    mute = () if judged else tuple(f"whether {unit} still works after a run: {why}" for why in baseline.mute)
    mute += tuple(f"{signature}: nominal runs of the whole system show the same" for signature in baseline.alarms)
    external = {name for name, each in workspace.context.file.components.items() if each.external}
    runs = step.system_runner(observe=(), pace=pace, judged=judged, unjudged=True)
    runner = _Inside(runs, external, baseline.alarms)
    return runner, baseline, (*mute, others)


def _save(step: StepRun, subject: _Subject, failure: Failure, baseline: Baseline) -> Path:
    """Write a finding; for a known one, update only its figures: its rate is that of the log it keeps.

    A simpler case replaces a known one, and its evidence, as long as there is no minimal log.
    """
    workspace = step.workspace
    name = finding_id(failure.violation) + ("-system" if subject.whole_system else "")
    folder = workspace.findings / name
    known = FindingRecord.find(folder)
    new = known is None
    if known is not None and known.fingerprint not in ("", workspace.fingerprint):
        put_aside(folder, known.fingerprint)
        known, new = None, True
    elif known is not None and not MinimalRecord.exists(folder):
        injections = [injection_of(row, str(folder)) for row in known.injections]
        if failure.complexity < complexity(injections, known.modified, failure.types):
            known = None  # a simpler case has been found since
            shutil.rmtree(folder / EVIDENCE, ignore_errors=True)
    if known is None:
        record = _write(step, subject, failure, folder)
    else:
        record = known.model_copy(
            update={
                "occurrences": max(known.occurrences, failure.occurrences),
                "details": tuple(dict.fromkeys([*known.details, *failure.details])),
                "trials": step.trials,
                "seconds": step.seconds,
            }
        )
    workspace.write_finding(folder, record)
    if not (folder / EVIDENCE).is_dir():
        within = baseline if subject.whole_system else None
        keep_evidence(workspace, record, failure.case, folder, in_system=within)
    if new:
        workspace.tell_finding(step.name, folder, record)
    return folder


def keep_evidence(
    workspace: Workspace, finding: FindingRecord, case: TestCase, folder: Path, *, in_system: Baseline | None = None
) -> None:
    """Repeat a case until it leaves evidence, or by its failure rate would have at 95 %, at most 30 times.

    Args:
        in_system: Baseline of its unit in nominal runs of the whole system, if trials are such runs.
    """
    share = finding.rate.value if finding.rate else 1.0
    tries = min(_MOST_TRIES, math.log(_MISSED) / math.log1p(-share)) if 0 < share < 1 else 1.0
    keep = workspace.runners.keep_evidence
    for _ in range(math.ceil(tries / _TRIES)):
        if keep(finding.unit, case, finding.signature, folder / EVIDENCE, in_system=in_system):
            return


def put_aside(folder: Path, fingerprint: str) -> Path:
    """Move the results of a finding from another version of the system into a folder of their own, and return that.

    `finding.json` is moved last: as long as it is there, an interrupted move is done again.
    """
    names = itertools.chain([fingerprint], (f"{fingerprint}-{number}" for number in itertools.count(2)))
    target = next(path for name in names if not FindingRecord.exists(path := folder / "earlier" / name))
    target.mkdir(parents=True, exist_ok=True)
    for path in sorted(folder.iterdir(), key=lambda path: path.name == FindingRecord.FILE):
        if path.name != "earlier":
            path.replace(target / path.name)
    return target


def _rate(rate: Proportion | None) -> ProportionRecord | None:
    return None if rate is None else ProportionRecord.of(rate)


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


def _write(step: StepRun, subject: _Subject, failure: Failure, folder: Path) -> FindingRecord:
    workspace, injections = step.workspace, failure.case.injections
    context, delivered = workspace.context, tuple(failure.outcome.statistics.get("delivered", ()))
    if len(delivered) == len(injections):  # else it is unknown which were delivered
        injections = tuple(each for each, count in zip(injections, delivered, strict=True) if count)
        delivered = tuple(filter(None, delivered))
    folder.mkdir(parents=True, exist_ok=True)
    if subject.whole_system:
        messages, modified = _keep_external(failure, folder), failure.modified
    else:
        messages, modified = _keep_failing(workspace, subject.log, failure, folder)
    return FindingRecord(
        id=folder.name,
        system=context.file.system.name,
        system_file=str(context.file.path),
        fingerprint=workspace.fingerprint,
        unit=subject.unit,
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
        delivered=delivered,
        messages=messages,
        modified=modified,
        external=bool(context.file.external.topics),
        whole_system=subject.whole_system,
        malformed=failure.malformed and subject.malformed == "group",
        seed=workspace.seed,
        trials=step.trials,
        seconds=step.seconds,
    )


def _keep_external(failure: Failure, folder: Path) -> int:
    """Keep the external messages of the failing run, as delivered; return their number."""
    if failure.outcome.log is None or not Path(failure.outcome.log).is_file():  # it was removed
        return 0
    shutil.copyfile(failure.outcome.log, folder / "failure.mcap")
    return len(read_log(folder / "failure.mcap"))


def _keep_failing(workspace: Workspace, log: Sequence[Message], failure: Failure, folder: Path) -> tuple[int, int]:
    """Keep the log that failed up to the failure; return the number of its messages, and of the modified ones."""
    context = workspace.context
    numbered = [message.with_(sequence=number) for number, message in enumerate(log)]
    delivered, touched = inject_log(numbered, failure.case.injections, registry=context.registry, seed=workspace.seed)
    prefix = delivered[: failure.played] if failure.played else delivered
    numbers = {message.sequence for message in prefix}
    originals = {original.sequence: original for _, original, _ in touched if original.sequence in numbers}
    changes = {original.sequence: made for _, original, made in touched}
    metadata = {"finding": folder.name, "signature": failure.violation.signature, "seed": str(workspace.seed)}
    FailingLog(prefix, originals).save(folder / "failure.mcap", context=context, metadata=metadata, changes=changes)
    return len(prefix), len(originals)
