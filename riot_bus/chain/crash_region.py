"""The region around a failing point of the whole system, for the record (RIOT III, Fig. 2)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from riot_bus.backchain.region import FIT, Region, map_region
from riot_bus.chain.region_rule import RegionRule, box_rule, learnt_rule, with_simple_limits
from riot_bus.findings.permeability import PermeabilityRecord
from riot_bus.findings.records import ProportionRecord, RangeRecord, RegionRecord
from riot_bus.statistics.rates import proportion
from riot_bus.vocabulary.counting import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.chain.driven_system import DrivenSystem
    from riot_bus.chain.external import ExternalField

__all__ = ["axes_of", "crash_region"]

_REGION_BUDGET, _AXES = 80, 2
"""Runs for a map of two fields, and these fields' number; more fields, if the failure needs them, get more runs."""
_EDGE = 0.05  # of the spread; half of it takes about one more run for each edge


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
        tolerance=[_EDGE * axis.spread for axis in axes],
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
