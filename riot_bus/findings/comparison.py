"""Comparison of two campaigns: which failures are new, which persist, and which the newer one has not shown."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict

from riot_bus.findings.records import CampaignRecord, FindingRecord, ProportionRecord
from riot_bus.statistics.rates import Proportion, proportion
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError

_Failure = tuple[str, ProportionRecord | None]
Change = Literal["new", "comes more often", "still failing", "comes less often", "not seen"]
"""What became of a failure, in the order in which failures are listed."""


class ComparedFinding(BaseModel):
    """One failure in both campaigns, with the rates of its fresh trials; None where it was not found."""

    model_config = ConfigDict(frozen=True)

    signature: str
    severity: str
    change: Change
    old: ProportionRecord | None
    new: ProportionRecord | None


class Comparison(BaseModel):
    """Changes in the failures of a unit between two campaigns."""

    model_config = ConfigDict(frozen=True)

    unit: str
    old: Proportion
    new: Proportion
    findings: tuple[ComparedFinding, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the comparison as JSON values."""
        return self.model_dump(mode="json")

    def lines(self) -> Iterator[str]:
        """Yield the changes for people; a failure that was not seen may need other trials to appear."""
        for each in self.findings:
            rates = " -> ".join(_said(one) if one else "-" for one in (each.old, each.new))
            yield f"{each.change:<17} {each.signature} (fresh trials: {rates})"
        for name, one in (("old", self.old), ("new", self.new)):
            yield f"{name}: {one.hits} of {counted(one.total, 'trial')} failed, 95 %: {one.low:.1%} to {one.high:.1%}"


def _said(rate: ProportionRecord) -> str:
    return f"{rate.count} of {rate.total}, 95 %: {rate.low:.0%} to {rate.high:.0%}"


def compare(old: Path, new: Path) -> Comparison:
    """Compare two output folders of `riot test`.

    Raises:
        ConfigError: A folder holds no finished campaign, the units differ, or only one is of the whole system.
    """
    before, after = CampaignRecord.load(old), CampaignRecord.load(new)
    if before.unit != after.unit:
        raise ConfigError(f"campaigns of two units: {before.unit!r} and {after.unit!r}", where=f"{old}, {new}")
    if before.whole_system != after.whole_system:
        hint = "compare two of `riot test`, or two of `riot test --whole-system`"
        raise ConfigError(
            "one campaign is of the unit alone, one of the whole system", where=f"{old}, {new}", hint=hint
        )
    earlier, later = _failures(old, before), _failures(new, after)
    confirmed = earlier.keys() | later.keys()
    for failures, campaign in ((earlier, before), (later, after)):
        again = [each for each in campaign.unconfirmed if each.signature in confirmed]
        failures.update(
            {each.signature: ("", ProportionRecord.of(proportion(each.hits, each.repeats))) for each in again}
        )
    order, found = get_args(Change), []
    for signature in earlier.keys() | later.keys():
        severity, was = earlier.get(signature, ("", None))
        other, now = later.get(signature, ("", None))
        change = _change(was, now, seen=(signature in earlier, signature in later))
        found.append(ComparedFinding(signature=signature, severity=other or severity, change=change, old=was, new=now))
    found.sort(key=lambda each: (order.index(each.change), each.signature))
    return Comparison(
        unit=after.unit,
        old=proportion(before.failing, before.tested),
        new=proportion(after.failing, after.tested),
        findings=tuple(found),
    )


def _failures(folder: Path, campaign: CampaignRecord) -> dict[str, _Failure]:
    """Return the failures that a campaign found, and those of the same code that others left in its folder."""
    findings = folder / "findings"
    others = [FindingRecord.load(one) for one in FindingRecord.folders(findings) if one.name not in campaign.findings]
    same = (campaign.unit, campaign.fingerprint, campaign.whole_system)
    records = [
        *(each for each in others if (each.unit, each.fingerprint, each.whole_system) == same),
        *(FindingRecord.load(findings / name) for name in campaign.findings),  # the last of a signature counts
    ]
    return {record.signature: (record.severity, record.rate) for record in records}


def _change(old: ProportionRecord | None, new: ProportionRecord | None, *, seen: tuple[bool, bool]) -> Change:
    if not seen[0]:
        return "new"
    if not seen[1]:
        return "not seen"
    if old and new and new.low > old.high:
        return "comes more often"
    if old and new and new.high < old.low:
        return "comes less often"
    return "still failing"
