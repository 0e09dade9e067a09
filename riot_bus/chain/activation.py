"""Step `activate`: external inputs that make the whole system fail, and the region around them (RIOT II-D)."""

from __future__ import annotations

import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from riot_bus.backchain.activation import Evaluation, activate
from riot_bus.backchain.axes import choose_axes
from riot_bus.backchain.encoding import SearchField
from riot_bus.backchain.proposers import PORTFOLIO
from riot_bus.backchain.region import Region, map_region
from riot_bus.chain.external import ExternalField, driving_log, external_fields
from riot_bus.chain.logs import internal_name
from riot_bus.findings.records import (
    ActivationRecord,
    FieldsRecord,
    FindingRecord,
    PermeabilityRecord,
    PointRecord,
    ProportionRecord,
    RegionRecord,
    RuleRecord,
)
from riot_bus.generalize.rule import Rule
from riot_bus.inject.apply import inject_log
from riot_bus.log.reader import read_log
from riot_bus.plugins import SEARCHES
from riot_bus.statistics.rates import chance_of_difference, proportion
from riot_bus.sut.system_trial import write_log
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import InconclusiveError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import Outcome, Series, TestCase

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.backchain.box import Sample
    from riot_bus.campaign.store import StoredRunner
    from riot_bus.chain.workspace import StepRun
    from riot_bus.sut.baseline import Baseline
    from riot_bus.vocabulary.message import Message

__all__ = ["activation", "least_distance"]

_REPLAYS = 10
_AGAIN, _FEWEST_AGAIN, _CHANCE = ((4, 10), (10, 10), (20, 40)), 2, 0.003
"""Runs at a failing point, and with nominal inputs, that are compared one pair after the other. Four failures of four
against none of ten have a chance of 0.001 if the rates are the same, six of twenty against none of forty one of 0.0008.
"""
_CONTROL_SEEDS = 1 << 20
"""Runs with nominal inputs have seeds that no other run of the step has."""
_REGION_BUDGET = 80
_EDGE = 0.05


def least_distance(rule: Rule, observed: Mapping[str, Series], scale: Mapping[str, float]) -> float | None:
    """Return the least distance to the rule over a run; None when a field of the rule was never seen.

    Fields are joined in time: at each sample of any of them, the latest value of every other.

    Args:
        rule: The unit-level rule.
        observed: Its variables over time.
        scale: Nominal spread of each variable.
    """
    names = rule.variables
    series = {name: observed[internal_name(name)] for name in names}
    if any(not one.values for one in series.values()):
        return None
    times = np.unique(np.concatenate([np.asarray(one.times) for one in series.values()]))
    times = times[times >= max(one.times[0] for one in series.values())]
    columns = {
        name: np.asarray(one.values)[np.searchsorted(np.asarray(one.times), times, side="right") - 1]
        for name, one in series.items()
    }
    return float(np.min(rule.distance(columns, scale)))


class _System:
    """Runs of the whole system with external fields held at given values.

    Args:
        step: The running step.
        folder: The finding.
        driving: What is played to it, with these fields changed; nothing where external components drive it.
        judged: The unit that is held against its nominal runs.
        budget: Runs at most that failing points are asked again with.
    """

    def __init__(
        self,
        step: StepRun,
        folder: Path,
        driving: tuple[Message, ...],
        judged: tuple[str, Baseline] | None = None,
        *,
        budget: int = 200,
    ) -> None:
        workspace = step.workspace
        self.step = step
        self.folder = folder
        self.finding = FindingRecord.load(folder)
        self.record = RuleRecord.load(folder)
        self.rule = Rule.from_json(self.record.rule)
        self.fields: dict[str, ExternalField] = {field.name: field for field in external_fields(workspace)}
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
            injections = tuple(
                Injection(self.fields[name].topic, self.fields[name].path, self._value(name, value))
                for name, value in sorted(point.items())
            )
            seed = self.step.workspace.seed + len(self.points) + len(cases)
            cases.append(TestCase(self.driving, injections, seed))
        evaluations = []
        for point, case, outcome in zip(points, cases, self.runner.run(cases), strict=True):
            evaluation = self._judge(outcome)
            self.points.append(
                PointRecord(values=dict(point), distance=evaluation.distance, failed=evaluation.failed, phase=phase)
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

    def seen(self, axes: tuple[str, str]) -> list[Sample]:
        """Return what came of two fields in runs that were for something else, the nominal ones included."""
        x, y = axes
        failed, total = self.controls()
        nominal = (self.fields[x].nominal, self.fields[y].nominal)
        phases = ("search", "needed")  # the others are of the region, or one point again and again
        asked = [point for point in self.points if point.phase in phases and {x, y} <= point.values.keys()]
        return [
            *((point.values[x], point.values[y], point.failed) for point in asked),
            *((*nominal, number < failed) for number in range(total)),
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
        """Return the inputs of a failing point without those that can be left alone, each one and all together."""
        names = list(found)
        if len(names) < 2:
            return dict(found)
        alone = self.run([{each: found[each] for each in names if each != name} for name in names], "needed")
        idle = [name for name, one in zip(names, alone, strict=True) if one.failed]
        while idle:
            kept = {name: value for name, value in found.items() if name not in idle}
            if kept and self._comes_again(kept):
                return kept
            del idle[0]  # the one that tells most
        return dict(found)

    def _value(self, name: str, value: float) -> float | int:
        return round(value) if self.fields[name].integer else value

    def _judge(self, outcome: Outcome) -> Evaluation:
        failed = outcome.failed_as(self.finding.signature)
        self.others.update({each.signature for each in outcome.violations} if not failed else ())
        return Evaluation(least_distance(self.rule, outcome.observed, self.record.scale), failed)


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
    system = _System(step, folder, driving, judged, budget=max(budget, _AGAIN[-1][0]))
    fields = [_search_field(system.fields[name]) for name in permeable.permeable]
    result = activate(
        fields,
        system.search,
        seed=step.workspace.seed,
        budget=budget,
        parallelism=system.runner.parallelism,
        methods=portfolio,
        progress=step.progress,
    )
    replays, messages = 0, 0
    found, text, region = None, result.text, None
    if result.found is not None:
        found = system.needed(result.found)
        text = replace(result, found=found).text
        messages, replays = _replay(system, *system.failing.get(frozenset(found.items()), (None, None)))
        region = _region(system, _axes(permeable), found)
    controls_failed, controls = system.controls() if result.found is not None or system.chance else (0, 0)
    return ActivationRecord(
        found=found,
        runs=result.runs,
        best_distance=result.best_distance,
        replays=_REPLAYS if messages else 0,
        replays_failed=replays,
        region=region,
        points=tuple(system.points),
        messages=messages,
        text=text,
        unneeded=tuple(name for name in result.found or () if name not in (found or ())),
        controls=controls,
        controls_failed=controls_failed,
        chance=system.chance,
        others=dict(system.others.most_common()),
        played=bool(driving),
    )


def _search_field(field: ExternalField) -> SearchField:
    low, high = field.range
    return SearchField(field.name, field.nominal, field.spread, low, high, integer=field.integer)


def _replay(system: _System, case: TestCase | None, log: str | None) -> tuple[int, int]:
    """Play the external messages alone to fresh runs; return how many they are and how often the failure came."""
    target = system.folder / "activation.mcap"
    if case is not None and case.messages:
        context, file = system.step.workspace.context, system.step.workspace.context.file
        external, _ = inject_log(case.messages, case.injections, registry=context.registry, seed=case.seed)
        write_log(target, external, context=context, metadata={"system": file.system.name, "seed": str(case.seed)})
    elif log is None:
        return 0, 0
    elif Path(log).is_file():
        shutil.copyfile(log, target)
    external = read_log(target)
    cases = [TestCase(external, seed=system.step.workspace.seed + number) for number in range(_REPLAYS)]
    outcomes = system.runner.run(cases)
    return len(external), sum(outcome.failed_as(system.finding.signature) for outcome in outcomes)


def _axes(permeable: PermeabilityRecord) -> list[str]:
    """Return the permeable external fields, the strongest of each relevant field first."""
    chosen: list[str] = []
    edges = sorted((edge for edge in permeable.edges if edge.permeable), key=lambda edge: -edge.strength)
    for internal in sorted({edge.internal for edge in edges}):
        best = next(edge.external for edge in edges if edge.internal == internal)
        if best not in chosen:
            chosen.append(best)
    return chosen + [name for name in permeable.permeable if name not in chosen]


def _region(system: _System, preferred: Sequence[str], found: Mapping[str, float]) -> RegionRecord | None:
    """Map the failing region over two fields; the others stay nominal if the failure does not need them."""
    if len(preferred) < 2:
        return None

    def fails(points: Sequence[Mapping[str, float]]) -> list[bool]:
        return [one.failed for one in system.run(points, "region")]

    nominal = {name: system.fields[name].nominal for name in preferred}
    axes, fixed = choose_axes(preferred, found, nominal, fails)
    start = {name: found.get(name, nominal[name]) for name in axes}

    def ask(points: Sequence[Mapping[str, float]]) -> list[bool]:
        return fails([{**point, **fixed} for point in points])

    x, y = (_search_field(system.fields[name]) for name in axes)
    region = map_region(
        start,
        (x, y),
        ask,
        seed=system.step.workspace.seed,
        budget=_REGION_BUDGET,
        tolerance=(_EDGE * x.spread, _EDGE * y.spread),
        parallelism=system.runner.parallelism,
        progress=system.step.progress,
    )
    seen = [] if fixed else system.seen(axes)
    return _region_record(region, axes, seen)


def _region_record(region: Region, axes: tuple[str, str], others: Sequence[Sample]) -> RegionRecord:
    """Return a region and how often the system fails inside it, by its own samples and others at hand."""
    inside = [bad for x, y, bad in (*region.samples, *others) if _within(region, x, y)]
    share = proportion(sum(inside), len(inside))
    record = RegionRecord(
        x=axes[0],
        y=axes[1],
        x_min=region.x_min,
        x_max=region.x_max,
        y_min=region.y_min,
        y_max=region.y_max,
        inside=ProportionRecord(value=share.rate, low=share.low, high=share.high, count=share.hits, total=share.total),
        ends=region.ends,
    )
    text = f"{' and '.join(record.bounds())}: {share.hits} of {counted(share.total, 'run')} inside failed"
    return record.model_copy(update={"text": text if region.good else f"{text}; the zone is not a box"})


def _within(region: Region, x: float, y: float) -> bool:
    return region.x_min <= x <= region.x_max and region.y_min <= y <= region.y_max
