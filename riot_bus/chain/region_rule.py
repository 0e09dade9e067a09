"""The crash region as a rule over external fields, with the simplest numbers that its runs allow (RIOT II-D)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from riot_bus.backchain.box import Box
from riot_bus.backchain.region import FIT
from riot_bus.findings.records import ProportionRecord, RuleRecord, RuleSample
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.numbers import simplest, step
from riot_bus.generalize.rule import Rule
from riot_bus.generalize.rules import learn_from
from riot_bus.generalize.sampling import Variable
from riot_bus.generalize.table import Table
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.counting import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.backchain.box import Place, RegionSample
    from riot_bus.backchain.region import Region
    from riot_bus.chain.driven_system import DrivenSystem
    from riot_bus.chain.external import ExternalField
    from riot_bus.vocabulary.trial import Scalar

__all__ = ["FOLDER", "RegionRule", "box_rule", "learnt_rule", "with_simple_limits"]

FOLDER = "region"
"""Folder within that of the finding, where the rule is."""
_FRESH, _LEAST = 20, 5
"""Runs that test a learnt rule, half of them where it predicts a failure; and the fewest runs on either side."""
_DRAWS = 1000  # a rule that holds in 1 % of the span gets `_LEAST` places with 97 %


class RegionRule(NamedTuple):
    """A rule over external fields.

    Attributes:
        rule: The rule.
        samples: Values of its fields, and whether a run with them failed.
        tested: Runs that the rule was not learnt from: whether each was predicted to fail, and whether it did.
    """

    rule: Rule
    samples: Sequence[RuleSample]
    tested: Sequence[tuple[bool, bool]] = ()

    @property
    def holds(self) -> bool:
        """Whether nine of ten tested runs are as predicted on either side, with at least a few on each."""
        inside, outside = ([failed for said, failed in self.tested if said is side] for side in (True, False))
        enough = min(len(inside), len(outside)) >= _LEAST
        return enough and sum(inside) >= FIT * len(inside) and sum(outside) <= (1 - FIT) * len(outside)

    @property
    def text(self) -> str:
        """The rule and the results of its test."""
        inside, outside = ([failed for said, failed in self.tested if said is side] for side in (True, False))
        return (
            f"it fails when {self.rule.text()} ({sum(inside)} of {counted(len(inside), 'fresh run')} where this holds "
            f"failed, {sum(outside)} of {len(outside)} where it does not)"
        )

    def save(self, folder: Path, fields: Sequence[ExternalField]) -> None:
        """Write it into a finding's folder as a rule that `riot scan` and guards accept.

        Args:
            folder: Folder of the finding.
            fields: Fields of the rule; nothing is written if one is not a field of a log, such as a parameter.
        """
        if any(field.constant for field in fields):
            return
        (folder / FOLDER).mkdir(exist_ok=True)
        RuleRecord(
            text=self.rule.text(),
            rule=self.rule.to_dict(),
            precision=_rate([failed for said, failed in self.tested if said]),
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
        region: The region, which is a box.
        fields: Fields of the box.
        fixed: Values of other fields that the failure needs.
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
        system: The system, which runs the tests.
        region: The region, which is not a box.
        fields: Fields of the region.
        fixed: Places of other fields that the failure needs.
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
    for _ in range(_DRAWS):
        place = tuple(axis.decode(rng.uniform(*span)) for axis, span in zip(axes, spans, strict=True))
        values = {field.name: np.array([_value(field, at)]) for field, at in zip(fields, place, strict=True)}
        some = found[bool(rule.predict(values)[0])]
        if len(some) < _FRESH // 2 and place not in known:
            some.append(place)
            known.add(place)
    return [(said, place) for said, places in found.items() for place in places]


def _rate(answers: Sequence[bool]) -> ProportionRecord:
    return ProportionRecord.of(proportion(sum(answers), len(answers)))


def _equal(fixed: Mapping[str, Scalar]) -> list[Literal]:
    return [Literal(Feature("raw", (name,)), "==", value) for name, value in fixed.items()]


def _limit(field: ExternalField, operator: str, edge: float) -> Literal:
    feature = Feature("raw", (field.name,))
    if field.type == "bool":
        return Literal(feature, "==", operator == ">=")
    return Literal(feature, operator, int(edge) if field.integer else edge)


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
