"""The whole system for a search: runs with external inputs, and their distances to the rule (RIOT II-D)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice, product
from pathlib import Path
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from riot_bus.backchain.activation import Activation, Evaluation
from riot_bus.backchain.box import RegionSample
from riot_bus.backchain.encoding import Encoding
from riot_bus.backchain.varied import Drive, VariedInputs
from riot_bus.campaign.store import StoredRunner
from riot_bus.chain.base.external import ExternalField, external_fields
from riot_bus.chain.base.logs import internal_name
from riot_bus.chain.base.workspace import StepRun
from riot_bus.chain.unit.prediction import alike, column_of
from riot_bus.chain.whole.driven import changed_in_log
from riot_bus.findings.activation import PointRecord
from riot_bus.findings.records import FindingRecord, RuleRecord
from riot_bus.generalize.rule import Rule
from riot_bus.statistics.rates import chance_of_difference
from riot_bus.system.system_file import SystemFile
from riot_bus.trial.baseline import Baseline
from riot_bus.types.latest import place_of
from riot_bus.vocabulary.injection import Curve, Injection
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.trial import Outcome, Series, TestCase

AGAIN, _FEWEST_AGAIN, _CHANCE = ((4, 10), (10, 10), (20, 40)), 2, 0.003
"""Numbers of runs at a failing point and with nominal inputs, compared pair after pair. Four failures of four against
none of ten have a chance of 0.001 if the rates are the same, and six of twenty against none of forty 0.0008."""
_FRESH, _FRESH_CHANCE = 20, 0.05
"""Further runs of either kind if a failing point does not always fail, as the earlier ones were tested repeatedly."""
_HELD_UP = 0.25
"""Share of a run's time: in one that waited so long for a processor, messages may have come too late to matter (in one
that had waited for a third, a goal had no effect; the search turned away from it, and took 165 runs instead of 27)."""
_ODD = (math.nan, math.inf, -math.inf)


def least_distance(
    rule: Rule, observed: Mapping[str, Series], scale: Mapping[str, float], topics: Sequence[str] = ()
) -> float | None:
    """Return the least distance to the rule over a run; None if one of its fields was never seen, or it has no field.

    Fields are joined in time: each sample of one field meets the latest value of every other one, or the value in an
    earlier message if the rule refers to that.
    """
    stamps: dict[str, NDArray[np.float64]] = {}
    values: dict[str, Sequence[Scalar]] = {}
    for name in rule.variables:
        place, series = place_of(name, topics), observed[internal_name(name)]
        stamps[name] = np.asarray(series.times[place.back :])
        values[name] = series.values[: len(stamps[name])]
    if not stamps or not all(map(len, stamps.values())):
        return None
    times = np.unique(np.concatenate(list(stamps.values())))
    times = times[times >= max(one[0] for one in stamps.values())]
    columns = {
        name: column_of([values[name][at] for at in np.searchsorted(one, times, side="right") - 1])
        for name, one in stamps.items()
    }
    rows = alike(columns, len(times))
    return min(float(np.min(rule.distance({name: one[at] for name, one in columns.items()}, scale))) for at in rows)


class DrivenSystem:
    """Runs of the whole system with external fields held at given values.

    Args:
        driving: Messages played to the system, with fields changed; empty if external components drive it.
        judged: Name and baseline of the unit that is compared with its nominal runs.
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
        self.controls_others = Counter[str]()
        self._controls = 0, 0
        self._left = budget

    def only_reached(self, names: Sequence[str]) -> list[str]:
        """Return the fields that can be set in some message of a run; the others will not vary in time either.

        If components publish the messages, this takes one or two runs with fields at an end of their nominal range.
        """
        fields = [self.fields[name] for name in names if not self.fields[name].parameter]
        reached: set[str] = set()
        for value in ("low", "high"):
            # messages can only be late or lost if there are any
            injections = tuple(
                Injection(each.topic, fault="delay", delay=1e-3)
                if each.timing
                else each.injection(getattr(each, value))
                for each in fields
            )
            case = TestCase(self.driving, injections, self.step.workspace.seed)
            if self.driving:
                reached |= changed_in_log(fields, case, self.step.workspace.context.registry)
            else:
                (outcome,) = self.runner.run([case])
                counts = outcome.statistics.get("delivered")
                if outcome.violations or counts is None:  # it has ended early, or an earlier version does not say
                    return list(names)
                reached |= {each.name for each, count in zip(fields, counts, strict=True) if count}
            if len(reached) == len(fields):
                break
        kept = [name for name in names if self.fields[name].parameter or name in reached]
        self.varied = _varied([self.fields[name] for name in kept], self.driving, self.step.workspace.context.file)
        return kept

    def run(self, points: Sequence[Mapping[str, float]], phase: str) -> list[Evaluation]:
        """Run the system at each point."""
        cases: list[TestCase] = []
        for point in points:
            injections = tuple(map(self._injection, self.varied.drives(point)))
            seed = self.step.workspace.seed + len(self.points) + len(cases)
            cases.append(TestCase(self.driving, injections, seed))
        evaluations = []
        for point, case, outcome in zip(points, cases, self._outcomes(cases), strict=True):
            evaluation = Evaluation(self._distance(outcome), outcome.failed_as(self.finding.signature))
            self.others.update(self.otherwise([outcome]))
            self.points.append(
                PointRecord(
                    values=self.told(point), distance=evaluation.distance, failed=evaluation.failed, phase=phase
                )
            )
            if evaluation.failed:
                self.failing.setdefault(frozenset(point.items()), (case, outcome.log))
            evaluations.append(evaluation)
        return evaluations

    def _outcomes(self, cases: Sequence[TestCase]) -> list[Outcome]:
        """Run the system; runs that say nothing of the rule, and may lack what was late, are repeated once."""
        outcomes = list(self.runner.run(cases))
        pace = self.step.workspace.context.file.system.trial_run
        late = [
            number
            for number, one in enumerate(outcomes)
            if one.statistics.get("held_up", 0.0) > _HELD_UP * pace.duration / pace.speed
            and not one.violations
            and self._distance(one) is None
        ]
        for number, outcome in zip(late, self.runner.run([replace(cases[at], again=1) for at in late]), strict=True):
            outcomes[number] = outcome if outcome.judged else outcomes[number]
        return outcomes

    def search(self, points: Sequence[Mapping[str, float]]) -> list[Evaluation]:
        """Run the system at each point; a failure counts if it recurs more often than with nominal inputs."""
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

    def odd_points(self, names: Sequence[str]) -> list[dict[str, float]]:
        """Return points with values that are not finite, in single fields and in all, if the unit failed with such."""
        if not any(any(map(_odd, sample.values.values())) for sample in self.record.samples if sample.failed):
            return []
        carry = [name for name in names if not (self.fields[name].integer or self.fields[name].timing)]
        alone = [{name: value} for value in _ODD for name in carry]
        return alone + [dict.fromkeys(carry, value) for value in _ODD if len(carry) > 1]

    def search_each(self, points: Sequence[Mapping[str, float]]) -> Activation:
        """Run the system at points in order until one fails, and return the result."""
        history: list[tuple[Mapping[str, float], Evaluation]] = []
        found = None
        while found is None and (batch := points[len(history) : len(history) + self.runner.parallelism]):
            history += zip(batch, self.search(batch), strict=True)
            found = next((point for point, one in history if one.failed), None)
            self.step.progress(len(history), len(points), "values that are not finite")
        nearest = min((one.distance for _, one in history if one.distance is not None), default=None)
        return Activation(found, len(history), nearest, tuple(history))

    def limited(self) -> list[str]:
        """Return the fields that are at an end of their range in the nearest point with constant values."""
        constant = [one for one in self.points if one.values.keys() <= self.fields.keys()]
        near = [(one.distance, place) for place, one in enumerate(constant) if one.distance is not None]
        values = constant[min(near)[1]].values if near else {}
        ends = {name: map(self.fields[name].told, self.fields[name].range) for name in values}
        return [name for name, some in ends.items() if not self.fields[name].choices and values[name] in some]

    def _comes_again(self, point: Mapping[str, float]) -> bool:
        """Return whether a failure recurs more often at a point than in runs with nominal inputs.

        The more points were chance before, the stronger the evidence must be: all false answers together have a chance
        of one percent. When the budget of these runs is used up, the answer is no.
        """
        asked = self.chance + 1
        failed = total = 0
        for number, (count, controls) in enumerate(AGAIN):
            self._left -= count - total
            if self._left < 0:
                break
            failed += sum(one.failed for one in self.run([point] * (count - total), "again"))
            total = count
            if chance_of_difference(failed, total, *self.controls(controls)) <= _CHANCE / (asked * (asked + 1)):
                return failed == total or self._still_comes(point)
            if number and failed < _FEWEST_AGAIN:
                break
        return False

    def _still_comes(self, point: Mapping[str, float]) -> bool:
        """Return whether fresh runs alone show that a failure is more frequent at a point than with nominal inputs."""
        self._left -= _FRESH
        known = self._controls
        failed = sum(one.failed for one in self.run([point] * _FRESH, "again"))
        controls = self.controls(known[1] + _FRESH)
        fresh = controls[0] - known[0], controls[1] - known[1]
        return chance_of_difference(failed, _FRESH, *fresh) <= _FRESH_CHANCE

    def seen(self, axes: Sequence[str], fixed: Mapping[str, float]) -> list[RegionSample]:
        """Return the samples of some fields from runs with another purpose, the nominal ones included.

        Args:
            axes: Names of the fields; a run that left one alone had its nominal value.
        """
        failed, total = self.controls()
        usual = {name: self.fields[name].told(self.fields[name].nominal) for name in (*axes, *fixed)}
        phases = ("search", "needed")  # the others are of the region, or repeat one point
        asked = [(point.values, point.failed) for point in self.points if point.phase in phases]
        asked += [({}, number < failed) for number in range(total)]
        told = self.told(fixed)
        return [
            RegionSample(tuple(filter(_is_number, map(values.__getitem__, axes))), bad)
            for values, bad in (
                ({**usual, **values}, bad) for values, bad in asked if values.keys() <= self.fields.keys()
            )
            if all(values[name] == value for name, value in told.items())
        ]

    def controls(self, least: int = AGAIN[0][1]) -> tuple[int, int]:
        """Return how many runs with nominal inputs failed the same way, of how many, after running at least `least`."""
        failed, total = self._controls
        if total < least:
            first = self.step.workspace.seed + (1 << 20)  # seeds that no other run of the step has
            cases = [TestCase(self.driving, seed=first + number) for number in range(total, least)]
            outcomes = self.runner.run(cases)
            self._controls = failed + sum(one.failed_as(self.finding.signature) for one in outcomes), least
            self.controls_others.update(self.otherwise(outcomes))
        return self._controls

    def needed(self, found: Mapping[str, float]) -> dict[str, float]:
        """Return the inputs of a failing point without those that are not needed, each one and all together.

        Whole fields are tried first, then, if fields vary in time, the single numbers that define how.
        """
        fields: dict[str, list[str]] = {}
        for name in found:
            if field := self.varied.field_of.get(name):
                fields.setdefault(field, []).append(name)
        kept = self._without_idle(dict(found), list(fields.values()))
        if kept.keys() <= self.fields.keys():
            return kept
        return self._without_idle(kept, [[name] for name in kept if name in self.varied.field_of])

    def simplest(self, found: Mapping[str, float]) -> dict[str, float]:
        """Return constant inputs, with values that fields have in a failing point, if these suffice; else the point."""
        values: dict[str, dict[float, None]] = {}
        for drive in self.varied.drives(found):
            if drive.value is not None:
                values.setdefault(drive.field, {})[drive.value] = None
        points = [dict(zip(values, one, strict=True)) for one in islice(product(*values.values()), 8)]
        if values and not found.keys() <= self.fields.keys():
            for point, one in zip(points, self.run(points, "needed"), strict=True):
                if one.failed and self._comes_again(point):
                    return point
        return dict(found)

    def deeper(self, found: Mapping[str, float]) -> dict[str, float] | None:
        """Return a failing point with the numbers of the failed run that is farthest from all runs that passed.

        That run may have changed more fields. Return None if there is no such point, or fields vary in time.
        """
        fields = [one for name in found if (one := self.fields.get(name)) and not one.choices]
        if not fields or not found.keys() <= self.fields.keys():
            return None
        scale = Encoding(tuple(one.search_field() for one in fields))

        def place(values: Mapping[str, Scalar]) -> NDArray[np.float64] | None:
            told = {one.name: values.get(one.name, one.nominal) for one in fields}
            numbers = {name: value for name, value in told.items() if _is_number(value) and math.isfinite(value)}
            return (
                scale.encode(numbers) if len(numbers) == len(fields) and values.keys() <= self.fields.keys() else None
            )

        passed = [spot for one in self.points if not one.failed and (spot := place(one.values)) is not None]
        best, depth = dict(found), 0.0
        for values in map(dict, self.failing):
            spot = place(values)
            near = 0.0 if spot is None else min((float(np.linalg.norm(spot - one)) for one in passed), default=0.0)
            if near > depth:
                best, depth = {**found, **{one.name: values.get(one.name, found[one.name]) for one in fields}}, near
        return best if best != found else None

    def _without_idle(self, found: dict[str, float], groups: Sequence[Sequence[str]]) -> dict[str, float]:
        if len(groups) < 2:
            return found
        alone = self.run([{name: found[name] for name in found if name not in group} for group in groups], "needed")
        idle = [group for group, one in zip(groups, alone, strict=True) if one.failed]
        while idle:
            kept = {name: value for name, value in found.items() if not any(name in group for group in idle)}
            if self.moved(kept) and self._comes_again(kept):
                return kept
            del idle[0]  # the strongest one
        return found

    def moved(self, point: Mapping[str, float]) -> set[str]:
        """Return the fields that a point changes."""
        return {each.field for each in self.varied.drives(point)}

    def told(self, point: Mapping[str, float]) -> dict[str, Scalar]:
        """Return a point with the values that fields get, in their own types."""
        return {name: self._told(name, value) for name, value in point.items()}

    def in_words(self, point: Mapping[str, float]) -> str:
        """Return a text on how a point changes the fields."""
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
        speed = self.step.workspace.context.file.system.trial_run.speed
        return field.injection(drive.value, speed=speed, start=drive.start, end=drive.end, message=drive.message)

    def otherwise(self, outcomes: Sequence[Outcome]) -> list[str]:
        """Return the signatures of runs that failed, but not as the finding does, each once for each run."""
        some = (outcome for outcome in outcomes if not outcome.failed_as(self.finding.signature))
        return [signature for outcome in some for signature in {each.signature for each in outcome.violations}]

    def _distance(self, outcome: Outcome) -> float | None:
        return least_distance(self.rule, outcome.observed, self.record.scale, self.record.topics)


def _varied(fields: Sequence[ExternalField], driving: Sequence[Message], file: SystemFile) -> VariedInputs:
    pace, speed = file.system.trial_run, file.system.nominal_run.speed
    seconds = pace.duration / pace.speed
    if driving and driving[-1].time > driving[0].time:
        seconds = min(seconds, (driving[-1].time - driving[0].time) / 1e9)
    counts = [0 if field.constant else 1 + round(field.rate * pace.duration / speed) for field in fields]
    return VariedInputs([field.search_field() for field in fields], seconds, counts)


def _odd(value: Scalar) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def _is_number(value: Scalar | None) -> TypeGuard[float]:
    return isinstance(value, int | float)


def _shown(value: Scalar) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
