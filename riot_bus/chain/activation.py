"""Step `activate`: external inputs that make the whole system fail, and the region around them (RIOT II-D)."""

from __future__ import annotations

import math
import shutil
from collections import Counter
from dataclasses import replace
from itertools import islice, product
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeGuard

import numpy as np

from riot_bus.backchain.activation import Activation, Evaluation, activate
from riot_bus.backchain.box import Sample
from riot_bus.backchain.proposers import PORTFOLIO
from riot_bus.backchain.region import Region, map_region
from riot_bus.backchain.varied import VariedInputs
from riot_bus.chain.external import ExternalField, driving_log, external_fields
from riot_bus.chain.logs import internal_name
from riot_bus.chain.prediction import alike, column_of
from riot_bus.findings.records import (
    ActivationRecord,
    FieldsRecord,
    FindingRecord,
    PermeabilityRecord,
    PointRecord,
    ProportionRecord,
    RangeRecord,
    RegionRecord,
    RuleRecord,
)
from riot_bus.generalize.rule import Rule
from riot_bus.inject.apply import inject_log
from riot_bus.log.reader import read_log
from riot_bus.plugins import SEARCHES
from riot_bus.statistics.rates import chance_of_difference, proportion
from riot_bus.sut.system_trial import write_log
from riot_bus.types.latest import place_of
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.injection import PARAMETERS, Curve, Injection
from riot_bus.vocabulary.trial import Outcome, Scalar, Series, TestCase

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from riot_bus.backchain.varied import Drive
    from riot_bus.campaign.store import StoredRunner
    from riot_bus.chain.workspace import StepRun
    from riot_bus.sut.baseline import Baseline
    from riot_bus.sut.system import SystemFile
    from riot_bus.vocabulary.message import Message

__all__ = ["activation", "least_distance"]

_REPLAYS = 10
_AGAIN, _FEWEST_AGAIN, _CHANCE = ((4, 10), (10, 10), (20, 40)), 2, 0.003
"""Runs at a failing point, and with nominal inputs, that are compared one pair after the other. Four failures of four
against none of ten have a chance of 0.001 if the rates are the same, six of twenty against none of forty one of 0.0008.
"""
_CONTROL_SEEDS = 1 << 20
"""Runs with nominal inputs have seeds that no other run of the step has."""
_REGION_BUDGET, _AXES = 80, 2
"""Runs for a map of two fields; of more fields, if the failure needs more, in proportion."""
_SIMPLER = 8
"""Points that are tried with constant values where values that vary in time were found."""
_ODD = (math.nan, math.inf, -math.inf)
_ONLY_ODD = "all failing trials of the unit had a value that is not finite, so only such values were tried"
_EDGE = 0.05


def least_distance(
    rule: Rule, observed: Mapping[str, Series], scale: Mapping[str, float], topics: Sequence[str] = ()
) -> float | None:
    """Return the least distance to the rule over a run; None when a field of the rule was never seen.

    Fields are joined in time: at each sample of any of them, the latest value of every other; of a message before the
    latest one, the value that it had.

    Args:
        rule: The unit-level rule.
        observed: Its variables over time.
        scale: Nominal spread of each variable.
        topics: Topic of each message of the short log in which the variables are named.
    """
    stamps: dict[str, NDArray[np.float64]] = {}
    values: dict[str, Sequence[Scalar]] = {}
    for name in rule.variables:
        place, series = place_of(name, topics), observed[internal_name(name)]
        stamps[name] = np.asarray(series.times[place.back :])
        values[name] = series.values[: len(stamps[name])]
    if not all(map(len, stamps.values())):
        return None
    times = np.unique(np.concatenate(list(stamps.values())))
    times = times[times >= max(one[0] for one in stamps.values())]
    columns = {
        name: column_of([values[name][at] for at in np.searchsorted(one, times, side="right") - 1])
        for name, one in stamps.items()
    }
    rows = alike(columns, len(times))
    return min(float(np.min(rule.distance({name: one[at] for name, one in columns.items()}, scale))) for at in rows)


class _System:
    """Runs of the whole system with external fields held at given values.

    Args:
        step: The running step.
        folder: The finding.
        driving: What is played to it, with these fields changed; nothing where external components drive it.
        judged: The unit that is held against its nominal runs.
        names: Of the fields that may be set.
        budget: Runs at most that failing points are asked again with.
    """

    def __init__(
        self,
        step: StepRun,
        folder: Path,
        driving: tuple[Message, ...],
        judged: tuple[str, Baseline] | None = None,
        *,
        names: Sequence[str] = (),
        budget: int = 200,
    ) -> None:
        workspace = step.workspace
        self.step = step
        self.folder = folder
        self.finding = FindingRecord.load(folder)
        self.record = RuleRecord.load(folder)
        self.rule = Rule.from_json(self.record.rule)
        self.fields: dict[str, ExternalField] = {field.name: field for field in external_fields(workspace)}
        self.varied = _varied([self.fields[name] for name in names], driving, workspace.context.file)
        self.runner: StoredRunner = step.system_runner(
            observe=sorted({internal_name(name) for name in self.rule.variables}),
            pace=workspace.context.file.system.trial_run,
            judged=judged,
            timed=False,
        )
        self.driving = driving
        self.points: list[PointRecord] = []
        self.failing: dict[frozenset[tuple[str, float]], tuple[TestCase, str | None]] = {}
        self.chance, self.others = 0, Counter[str]()
        self._controls = 0, 0
        self._left = budget

    def run(self, points: Sequence[Mapping[str, float]], phase: str) -> list[Evaluation]:
        cases: list[TestCase] = []
        for point in points:
            injections = tuple(map(self._injection, self.varied.drives(point)))
            seed = self.step.workspace.seed + len(self.points) + len(cases)
            cases.append(TestCase(self.driving, injections, seed))
        evaluations = []
        for point, case, outcome in zip(points, cases, self.runner.run(cases), strict=True):
            evaluation = self._judge(outcome)
            self.points.append(
                PointRecord(
                    values=self.told(point), distance=evaluation.distance, failed=evaluation.failed, phase=phase
                )
            )
            if evaluation.failed:
                self.failing.setdefault(frozenset(point.items()), (case, outcome.log))
            evaluations.append(evaluation)
        return evaluations

    def search(self, points: Sequence[Mapping[str, float]]) -> list[Evaluation]:
        """Run the system at each point; a failure counts if it comes again more often than with nominal inputs."""
        evaluations: list[Evaluation] = []
        for point, found in zip(points, self.run(points, "search"), strict=True):
            if found.failed and not any(one.failed for one in evaluations) and not self._comes_again(point):
                self.chance += 1
                found = replace(found, failed=False)
            evaluations.append(found)
        return evaluations

    def only_odd(self) -> bool:
        """Return whether all trials that taught the rule and failed had a value that is not finite."""
        failing = [sample for sample in self.record.samples if sample.failed]
        return bool(failing) and all(any(map(_odd, sample.values.values())) for sample in failing)

    def search_odd(self, names: Sequence[str], budget: int) -> Activation:
        """Return what comes of values that are not finite, in each field alone and in all; nothing if they do no harm.

        Args:
            names: Of the fields.
            budget: Runs at most.
        """
        points: list[dict[str, float]] = []
        if any(any(map(_odd, sample.values.values())) for sample in self.record.samples if sample.failed):
            carry = [name for name in names if not self.fields[name].integer]
            points = [{name: value} for value in _ODD for name in carry]
            points += [dict.fromkeys(carry, value) for value in _ODD if len(carry) > 1]
        history: list[tuple[Mapping[str, float], Evaluation]] = []
        found = None
        while found is None and (batch := points[len(history) : min(len(history) + self.runner.parallelism, budget)]):
            history += zip(batch, self.search(batch), strict=True)
            found = next((point for point, one in history if one.failed), None)
            self.step.progress(len(history), len(points), "values that are not finite")
        nearest = min((one.distance for _, one in history if one.distance is not None), default=None)
        return Activation(found, len(history), nearest, tuple(history))

    def _comes_again(self, point: Mapping[str, float]) -> bool:
        """Return whether a failure comes again more often at a point than in runs with nominal inputs.

        The more often that was asked, the surer it has to be: all false answers together have a chance of a percent.
        Where the runs for it are used up, nothing is shown any more.
        """
        asked = self.chance + 1
        failed = total = 0
        for number, (count, controls) in enumerate(_AGAIN):
            self._left -= count - total
            if self._left < 0:
                break
            failed += sum(one.failed for one in self.run([point] * (count - total), "again"))
            total = count
            if chance_of_difference(failed, total, *self.controls(controls)) <= _CHANCE / (asked * (asked + 1)):
                return True
            if number and failed < _FEWEST_AGAIN:
                break
        return False

    def seen(self, axes: Sequence[str]) -> list[Sample]:
        """Return what came of some fields in runs that were for something else, the nominal ones included."""
        failed, total = self.controls()
        nominal = tuple(self.fields[name].nominal for name in axes)
        phases = ("search", "needed")  # the others are of the region, or one point again and again
        asked = [
            (tuple(filter(_is_number, map(point.values.get, axes))), point.failed)
            for point in self.points
            if point.phase in phases
        ]
        return [
            *(Sample(place, bad) for place, bad in asked if len(place) == len(axes)),
            *(Sample(nominal, number < failed) for number in range(total)),
        ]

    def controls(self, least: int = _AGAIN[0][1]) -> tuple[int, int]:
        """Return how many runs with nominal inputs failed likewise, and how many there were; there are so many then."""
        failed, total = self._controls
        if total < least:
            first = self.step.workspace.seed + _CONTROL_SEEDS
            cases = [TestCase(self.driving, seed=first + number) for number in range(total, least)]
            outcomes = self.runner.run(cases)
            self._controls = failed + sum(one.failed_as(self.finding.signature) for one in outcomes), least
        return self._controls

    def needed(self, found: Mapping[str, float]) -> dict[str, float]:
        """Return the inputs of a failing point without those that can be left alone, each one and all together.

        Fields come first; of fields that vary in time, then the numbers that say how.
        """
        kept = dict(found)
        fields: dict[str, list[str]] = {}
        for name in found:
            if field := self.varied.field_of.get(name):
                fields.setdefault(field, []).append(name)
        kept = self._without_idle(dict(found), list(fields.values()))
        if kept.keys() <= self.fields.keys():
            return kept
        return self._without_idle(kept, [[name] for name in kept if name in self.varied.field_of])

    def simplest(self, found: Mapping[str, float]) -> dict[str, float]:
        """Return inputs that are constant if these suffice, of the values that fields have in a failing point."""
        values: dict[str, dict[float, None]] = {}
        for drive in self.varied.drives(found):
            if drive.value is not None:
                values.setdefault(drive.field, {})[drive.value] = None
        points = [dict(zip(values, one, strict=True)) for one in islice(product(*values.values()), _SIMPLER)]
        if not found.keys() <= self.fields.keys():
            for point, one in zip(points, self.run(points, "needed"), strict=True):
                if one.failed and self._comes_again(point):
                    return point
        return dict(found)

    def _without_idle(self, found: dict[str, float], groups: Sequence[Sequence[str]]) -> dict[str, float]:
        if len(groups) < 2:
            return found
        alone = self.run([{name: found[name] for name in found if name not in group} for group in groups], "needed")
        idle = [group for group, one in zip(groups, alone, strict=True) if one.failed]
        while idle:
            kept = {name: value for name, value in found.items() if not any(name in group for group in idle)}
            if self.moved(kept) and self._comes_again(kept):
                return kept
            del idle[0]  # the one that tells most
        return found

    def moved(self, point: Mapping[str, float]) -> set[str]:
        """Return the fields that a point does something to."""
        return {each.field for each in self.varied.drives(point)}

    def told(self, point: Mapping[str, float]) -> dict[str, Scalar]:
        """Return a point with the values that fields get, in their own types."""
        return {name: self._told(name, value) for name, value in point.items()}

    def in_words(self, point: Mapping[str, float]) -> str:
        """Return what a point does to the fields."""
        return ", ".join(
            f"{each.field} {each.how}"
            if each.value is None
            else f"{each.field} = {_shown(self._told(each.field, each.value))} {each.how}".rstrip()
            for each in self.varied.drives(point)
        )

    def _told(self, name: str, value: float) -> Scalar:
        field = self.varied.field_of.get(name)
        return value if field is None else self.fields[field].told(value)

    def _injection(self, drive: Drive) -> Injection:
        field = self.fields[drive.field]
        if drive.value is None:
            times, values = zip(*drive.points, strict=True)
            return Injection(field.topic, field.path, Curve(times, values, field.integer))
        first = drive.message or 0
        return Injection(
            field.topic,
            field.path,
            field.told(drive.value),
            start=drive.start,
            end=drive.end,
            first=first,
            last=drive.message,
        )

    def _judge(self, outcome: Outcome) -> Evaluation:
        failed = outcome.failed_as(self.finding.signature)
        self.others.update({each.signature for each in outcome.violations} if not failed else ())
        near = least_distance(self.rule, outcome.observed, self.record.scale, self.record.topics)
        return Evaluation(near, failed)


def _varied(fields: Sequence[ExternalField], driving: Sequence[Message], file: SystemFile) -> VariedInputs:
    pace, speed = file.system.trial_run, file.system.nominal_run.speed
    seconds = pace.duration / pace.speed
    if driving and driving[-1].time > driving[0].time:
        seconds = min(seconds, (driving[-1].time - driving[0].time) / 1e9)
    counts = [0 if field.parameter else 1 + round(field.rate * pace.duration / speed) for field in fields]
    return VariedInputs([field.search_field() for field in fields], seconds, counts)


def _odd(value: Scalar) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def _is_number(value: Scalar | None) -> TypeGuard[float]:
    return isinstance(value, int | float)


def _shown(value: Scalar) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def activation(step: StepRun, folder: Path, *, budget: int = 200, search: Sequence[str] = ()) -> ActivationRecord:
    """Search the permeable external fields until the whole system fails; write `activation.mcap`.

    Where runs of the whole system cannot tell the failure, nothing is searched, and the record says why.

    Args:
        step: The running step.
        folder: The finding.
        budget: Runs of the whole system for the search; as many at most ask failing points again.
        search: Names of search methods (entry points `riot_bus.search`); none for `PORTFOLIO`.

    Raises:
        ConfigError: A step before has not been done, or there is no such method.
        InconclusiveError: No external field is permeable, so there is nothing to search.
    """
    portfolio = [SEARCHES.load(name, where="--search") for name in search] or PORTFOLIO
    FieldsRecord.load(folder)
    permeable = PermeabilityRecord.load(folder)
    if not permeable.permeable:
        raise InconclusiveError(
            "no external field was found to reach the relevant ones, so the outside cannot be searched"
            if permeable.edges
            else "of no external field could be told whether it reaches the relevant ones",
            where=str(folder),
            hint="this finding stays at unit level; more runs (--runs) may show weaker effects",
        )
    driving = driving_log(step.workspace, step.workspace.context.file.system.trial_run)
    judged, why = step.workspace.judged_in_system(FindingRecord.load(folder), driving)
    if why:
        return ActivationRecord(found=None, runs=0, best_distance=None, text=f"not tested: {why}")
    names = permeable.permeable
    system = _System(step, folder, driving, judged, names=names, budget=max(budget, _AGAIN[-1][0]))
    odd, only_odd = system.search_odd(names, budget), system.only_odd()
    if odd.found is not None or only_odd or odd.runs == budget:
        result = odd
    else:
        result = activate(
            [system.fields[name].search_field() for name in names],
            system.search,
            seed=step.workspace.seed,
            budget=budget - odd.runs,
            parallelism=system.runner.parallelism,
            methods=portfolio,
            families=system.varied.families,
            progress=step.progress,
        )
        result = replace(result, runs=odd.runs + result.runs)
    replays, messages = 0, 0
    found, text, region = None, result.text + (f"; {_ONLY_ODD}" if only_odd else ""), None
    if result.found is not None:
        found = system.needed(system.simplest(result.found))
        text = result.with_inputs(system.in_words(found))
        messages, replays = _replay(system, *system.failing.get(frozenset(found.items()), (None, None)))
        region = _region(system, _axes(permeable, system.fields), found)
    controls_failed, controls = system.controls() if result.found is not None or system.chance else (0, 0)
    return ActivationRecord(
        found=None if found is None else system.told(found),
        runs=result.runs,
        best_distance=result.best_distance,
        replays=_REPLAYS if messages else 0,
        replays_failed=replays,
        region=region,
        points=tuple(system.points),
        messages=messages,
        text=text,
        unneeded=tuple(sorted(system.moved(result.found or {}) - system.moved(found or {}))),
        controls=controls,
        controls_failed=controls_failed,
        chance=system.chance,
        others=dict(system.others.most_common()),
        played=bool(driving),
    )


def _replay(system: _System, case: TestCase | None, log: str | None) -> tuple[int, int]:
    """Play the external messages alone to fresh runs; return how many they are and how often the failure came."""
    target = system.folder / "activation.mcap"
    if case is not None and case.messages:
        context, file = system.step.workspace.context, system.step.workspace.context.file
        injections = [each for each in case.injections if each.topic != PARAMETERS]
        external, _ = inject_log(case.messages, injections, registry=context.registry, seed=case.seed)
        write_log(target, external, context=context, metadata={"system": file.system.name, "seed": str(case.seed)})
    elif log is None:
        return 0, 0
    elif Path(log).is_file():
        shutil.copyfile(log, target)
    external = read_log(target)
    parameters = tuple(each for each in (case.injections if case else ()) if each.topic == PARAMETERS)
    cases = [TestCase(external, parameters, seed=system.step.workspace.seed + number) for number in range(_REPLAYS)]
    outcomes = system.runner.run(cases)
    return len(external), sum(outcome.failed_as(system.finding.signature) for outcome in outcomes)


def _axes(permeable: PermeabilityRecord, fields: Mapping[str, ExternalField]) -> list[str]:
    """Return the permeable external fields that are numbers, the strongest of each relevant field first."""
    chosen: list[str] = []
    edges = sorted((edge for edge in permeable.edges if edge.permeable), key=lambda edge: -edge.strength)
    for internal in sorted({edge.internal for edge in edges}):
        best = next(edge.external for edge in edges if edge.internal == internal)
        if best not in chosen:
            chosen.append(best)
    chosen += [name for name in permeable.permeable if name not in chosen]
    return [name for name in chosen if not fields[name].choices]


def _region(system: _System, preferred: Sequence[str], found: Mapping[str, float]) -> RegionRecord | None:
    """Map the failing region over the numbers that were found, and the most telling others if these are fewer than two.

    What is no number keeps its value. There is no region where fields have to vary in time, or are not finite.
    """
    if found.keys() - system.fields.keys() or not all(map(math.isfinite, found.values())):
        return None
    chosen = [name for name in preferred if name in found]
    chosen += [name for name in preferred if name not in found][: max(0, _AXES - len(chosen))]
    if not chosen:
        return None
    axes = [system.fields[name].search_field() for name in sorted(chosen, key=preferred.index)]
    fixed = {name: value for name, value in found.items() if name not in chosen}
    region = map_region(
        {axis.name: found.get(axis.name, axis.nominal) for axis in axes},
        axes,
        lambda points: [one.failed for one in system.run([{**fixed, **point} for point in points], "region")],
        seed=system.step.workspace.seed,
        budget=_REGION_BUDGET * max(_AXES, len(axes)) // _AXES,
        tolerance=[_EDGE * axis.spread for axis in axes],
        parallelism=system.runner.parallelism,
        progress=system.step.progress,
    )
    return _region_record(region, [] if fixed else system.seen([axis.name for axis in axes]), system.in_words(fixed))


def _region_record(region: Region, others: Sequence[Sample], fixed: str) -> RegionRecord:
    """Return a region and how often the system fails inside it, by its own samples and others at hand."""
    inside = [failed for place, failed in (*region.samples, *others) if region.box.contains(place)]
    share = proportion(sum(inside), len(inside))
    record = RegionRecord(
        ranges=tuple(_range(region, axis) for axis in range(len(region.names))),
        inside=ProportionRecord(value=share.rate, low=share.low, high=share.high, count=share.hits, total=share.total),
    )
    where = f"{' and '.join(record.bounds())}{f', with {fixed}' if fixed else ''}"
    text = f"{where}: {share.hits} of {counted(share.total, 'run')} inside failed"
    return record.model_copy(update={"text": text if region.good else f"{text}; the zone is not a box"})


def _range(region: Region, axis: int) -> RangeRecord:
    low, high = region.box.ranges[axis]
    sides: dict[int, Literal["low", "high"]] = {2 * axis: "low", 2 * axis + 1: "high"}
    ends = tuple(word for side, word in sides.items() if side in region.ends)
    return RangeRecord(field=region.names[axis], low=low, high=high, ends=ends)
