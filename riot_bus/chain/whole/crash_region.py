"""The region around a failing point of the whole system, as ranges and as a rule over external fields (RIOT III)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from riot_bus.backchain.box import Box, Place, RegionSample
from riot_bus.backchain.region import FIT, Region, map_region
from riot_bus.chain.base.external import ExternalField
from riot_bus.chain.whole.driven_system import DrivenSystem
from riot_bus.findings.activation import RangeRecord, RegionRecord
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import ProportionRecord, RuleRecord, RuleSample
from riot_bus.generalize import literals
from riot_bus.generalize.features import Feature
from riot_bus.generalize.numbers import simplest, step
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.rules import learn_from
from riot_bus.generalize.sampling import Variable
from riot_bus.generalize.table import Table
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.message import Scalar

FOLDER = "region"
"""Folder within that of the finding, where the rule is."""
_REGION_BUDGET, _AXES = 80, 2
"""Runs for a map of two fields, and these fields' number; more fields, if the failure needs them, get more runs."""
_FRESH, _LEAST = 20, 5
"""Runs that test a learnt rule, half of them where it predicts a failure; and the fewest runs on either side."""


class RegionRule(NamedTuple):
    """A rule over external fields.

    Attributes:
        tested: Runs that the rule was not learnt from: whether each was predicted to fail, and whether it did.
    """

    rule: Rule
    samples: Sequence[RuleSample]
    tested: Sequence[tuple[bool, bool]] = ()

    @property
    def holds(self) -> bool:
        """Whether nine of ten tested runs are as predicted on either side, with at least a few on each."""
        inside, outside = self._failed()
        enough = min(len(inside), len(outside)) >= _LEAST
        return enough and sum(inside) >= FIT * len(inside) and sum(outside) <= (1 - FIT) * len(outside)

    @property
    def text(self) -> str:
        """The rule and the results of its test."""
        inside, outside = self._failed()
        return (
            f"it fails when {self.rule.text()} ({sum(inside)} of {counted(len(inside), 'fresh run')} where this holds "
            f"failed, {sum(outside)} of {len(outside)} where it does not)"
        )

    def _failed(self) -> tuple[list[bool], list[bool]]:
        """Return which of the tested runs failed, of those where the rule holds and of the others."""
        inside, outside = ([failed for said, failed in self.tested if said is side] for side in (True, False))
        return inside, outside

    def save(self, folder: Path, fields: Sequence[ExternalField]) -> None:
        """Write it into a finding's folder as a rule that `riot scan` and guards accept."""
        if any(field.constant for field in fields):
            return
        (folder / FOLDER).mkdir(exist_ok=True)
        RuleRecord(
            text=self.rule.text(),
            rule=self.rule.to_dict(),
            precision=_rate(self._failed()[0]),
            recall=_rate([said for said, failed in self.tested if failed]),
            balanced_accuracy=None,
            checks=len(self.tested),
            scale={field.name: field.spread for field in fields},
            types={field.name: field.type for field in fields},
            samples=tuple(self.samples),
        ).save(folder / FOLDER)


def with_simple_limits(region: Region, fields: Sequence[ExternalField], samples: Sequence[RegionSample]) -> Region:
    """Return a region whose limits have as few digits as the samples allow: the same samples are inside."""
    edges = list(region.box.edges)
    for side, edge in enumerate(edges):
        axis, upper = divmod(side, 2)
        between = [place[axis] for place, _ in samples if region.box.contains(place, but=axis)]
        inside = [value for value in between if region.box.ranges[axis][0] <= value <= region.box.ranges[axis][1]]
        beyond = [value for value in between if (value > edge if upper else value < edge)]
        if inside and beyond and side not in region.ends:
            inner, outer = (max(inside), min(beyond)) if upper else (min(inside), max(beyond))
            if fields[axis].integer:
                inner, outer = round(inner), round(outer)
            edges[side] = float(simplest(*sorted((inner, step(outer, -1 if upper else 1)))))
    return replace(region, box=Box(tuple(edges)))


def box_rule(
    region: Region, fields: Sequence[ExternalField], fixed: Mapping[str, Scalar], samples: Sequence[RegionSample]
) -> RegionRule | None:
    """Return a box as a rule; None if it has no limits.

    Args:
        samples: All runs in which those other fields had these values.
    """
    literals = _equal(fixed)
    for axis, field in enumerate(fields):
        for side, operator in ((2 * axis, ">="), (2 * axis + 1, "<=")):
            if side not in region.ends:
                literals.append(_limit(field, operator, region.box.edges[side]))
    rule = Rule((tuple(literals),))
    return RegionRule(rule, _told(samples, fields, fixed)) if literals else None


def learnt_rule(
    system: DrivenSystem,
    region: Region,
    fields: Sequence[ExternalField],
    fixed: Mapping[str, float],
    samples: Sequence[RegionSample],
) -> RegionRule | None:
    """Return a rule that is learnt from runs and tested in fresh ones; None if nothing distinguishes them.

    Args:
        samples: All runs in which those other fields had these places.
    """
    told = {name: system.fields[name].told(value) for name, value in fixed.items()}
    known = _told(samples, fields, told)
    variables = [
        Variable(field.name, field.type, known[0].values[field.name], nominal=(_value(field, field.nominal),))
        for field in fields
    ]
    table = Table(variables)
    rows = [{field.name: one.values[field.name] for field in fields} for one in known]
    table.add(rows, [one.failed for one in known])
    rule = learn_from(table)[0].rule
    if not rule.variables:
        return None
    places = _fresh_places(rule, region, fields, seed=system.step.workspace.seed)
    points = [{**fixed, **{field.name: at for field, at in zip(fields, place, strict=True)}} for _, place in places]
    failed = [one.failed for one in system.run(points, "check")]
    tested = [(said, bad) for (said, _), bad in zip(places, failed, strict=True)]
    return RegionRule(Rule(tuple((*_equal(told), *term) for term in rule.terms)), known, tested)


def _fresh_places(
    rule: Rule, region: Region, fields: Sequence[ExternalField], *, seed: int
) -> list[tuple[bool, Place]]:
    """Draw as many places where a rule holds as others, uniformly over the samples' span on the search's scale."""
    rng = np.random.default_rng([seed, 43])
    known = {place for place, _ in region.samples}
    axes = [field.search_field() for field in fields]
    spans = [
        (axis.encode(min(values)), axis.encode(max(values)))
        for axis, values in zip(axes, zip(*known, strict=True), strict=True)
    ]
    found: dict[bool, list[Place]] = {True: [], False: []}
    for _ in range(1000):  # a rule that holds in 1 % of the span gets `_LEAST` places with 97 %
        place = tuple(axis.decode(rng.uniform(*span)) for axis, span in zip(axes, spans, strict=True))
        values = {field.name: np.array([_value(field, at)]) for field, at in zip(fields, place, strict=True)}
        some = found[bool(rule.predict(values)[0])]
        if len(some) < _FRESH // 2 and place not in known:
            some.append(place)
            known.add(place)
    return [(said, place) for said, places in found.items() for place in places]


def _rate(answers: Sequence[bool]) -> ProportionRecord:
    return ProportionRecord.of(proportion(sum(answers), len(answers)))


def _equal(fixed: Mapping[str, Scalar]) -> list[literals.Literal]:
    return [literals.Literal(Feature("raw", (name,)), "==", value) for name, value in fixed.items()]


def _limit(field: ExternalField, operator: str, edge: float) -> literals.Literal:
    feature = Feature("raw", (field.name,))
    if field.type == "bool":
        return literals.Literal(feature, "==", operator == ">=")
    return literals.Literal(feature, operator, int(edge) if field.integer else edge)


def _value(field: ExternalField, number: float) -> Scalar:
    value = field.told(number)
    return bool(value) if field.type == "bool" else value


def _told(
    samples: Sequence[RegionSample], fields: Sequence[ExternalField], fixed: Mapping[str, Scalar]
) -> list[RuleSample]:
    return [
        RuleSample(
            values={**fixed, **{field.name: _value(field, at) for field, at in zip(fields, place, strict=True)}},
            failed=failed,
            phase="region",
        )
        for place, failed in samples
    ]


def axes_of(permeable: PermeabilityRecord, fields: Mapping[str, ExternalField]) -> list[str]:
    """Return the permeable external fields that are numbers, the strongest of each relevant field first."""
    chosen: list[str] = []
    edges = sorted((edge for edge in permeable.edges if edge.permeable), key=lambda edge: -edge.strength)
    for internal in sorted({edge.internal for edge in edges}):
        best = next(edge.external for edge in edges if edge.internal == internal)
        if best not in chosen:
            chosen.append(best)
    chosen += [name for name in permeable.permeable if name not in chosen]
    return [name for name in chosen if not fields[name].choices]


def crash_region(system: DrivenSystem, preferred: Sequence[str], found: Mapping[str, float]) -> RegionRecord | None:
    """Map the failing region over the numeric fields that were found, and the strongest others if fewer than two.

    Other fields keep their values. Return None if fields have to vary in time, or are not finite.
    """
    if found.keys() - system.fields.keys() or not all(map(math.isfinite, found.values())):
        return None
    chosen = [name for name in preferred if name in found]
    chosen += [name for name in preferred if name not in found][: max(0, _AXES - len(chosen))]
    if not chosen:
        return None
    fields = [system.fields[name] for name in sorted(chosen, key=preferred.index)]
    axes = [field.search_field() for field in fields]
    fixed = {name: value for name, value in found.items() if name not in chosen}
    region = map_region(
        {axis.name: found.get(axis.name, axis.nominal) for axis in axes},
        axes,
        lambda points: [one.failed for one in system.run([{**fixed, **point} for point in points], "region")],
        seed=system.step.workspace.seed,
        budget=_REGION_BUDGET * max(_AXES, len(axes)) // _AXES,
        tolerance=[0.05 * axis.spread for axis in axes],  # half of it takes about one more run for each edge
        progress=system.step.progress,
    )
    samples = [*region.samples, *system.seen([axis.name for axis in axes], fixed)]
    region = with_simple_limits(region, fields, samples)
    inside = [failed for place, failed in samples if region.box.contains(place)]
    share = proportion(sum(inside), len(inside))
    record = RegionRecord(
        ranges=tuple(_range(region, axis) for axis in range(len(axes))), inside=ProportionRecord.of(share)
    )
    where = f"{' and '.join(record.bounds())}{f', with {system.in_words(fixed)}' if fixed else ''}"
    text = f"{where}: {share.hits} of {counted(share.total, 'run')} inside failed"
    rule: RegionRule | None
    if region.good and share.rate >= FIT:
        told = {name: system.fields[name].told(value) for name, value in fixed.items()}
        rule = box_rule(region, fields, told, samples)
    else:
        learnt = learnt_rule(system, region, fields, fixed, samples)
        rule = learnt if learnt and learnt.holds else None
        text += f"; the zone is not a box, {rule.text if rule else 'and no rule was found for it'}"
    if rule is not None:
        rule.save(system.folder, [system.fields[name] for name in rule.rule.variables])
    return record.model_copy(update={"text": text, "rule": rule.rule.text() if rule else ""})


def _range(region: Region, axis: int) -> RangeRecord:
    low, high = region.box.ranges[axis]
    sides: dict[int, Literal["low", "high"]] = {2 * axis: "low", 2 * axis + 1: "high"}
    ends = tuple(word for side, word in sides.items() if side in region.ends)
    return RangeRecord(field=region.names[axis], low=low, high=high, ends=ends)
