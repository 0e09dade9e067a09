"""Two campaigns side by side: which failures are new, which still come, and which the newer one has not shown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from riot_bus.findings.records import CampaignRecord, FindingRecord, ProportionRecord
from riot_bus.statistics.rates import Proportion, proportion

__all__ = ["ComparedFinding", "Comparison", "compare"]

Change = Literal["new", "still failing", "comes more often", "comes less often", "not seen"]


@dataclass(frozen=True, slots=True)
class ComparedFinding:
    """One failure in both campaigns, with the rates of its fresh trials; None where it was not found."""

    signature: str
    severity: str
    change: Change
    old: ProportionRecord | None
    new: ProportionRecord | None


@dataclass(frozen=True, slots=True)
class Comparison:
    """What has become of the failures of a unit.

    Attributes:
        old: Share of the older campaign's trials that failed.
        new: Likewise of the newer one.
    """

    unit: str
    old: Proportion
    new: Proportion
    findings: tuple[ComparedFinding, ...]

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON values."""
        found = [
            {
                "signature": each.signature,
                "severity": each.severity,
                "change": each.change,
                "old": each.old.model_dump() if each.old else None,
                "new": each.new.model_dump() if each.new else None,
            }
            for each in self.findings
        ]
        return {"unit": self.unit, "old": asdict(self.old), "new": asdict(self.new), "findings": found}

    def lines(self) -> Iterator[str]:
        """Yield what has changed, for people: a failure that was not seen may need other trials to come."""
        for each in self.findings:
            rates = " -> ".join(f"{one.count} of {one.total}" if one else "-" for one in (each.old, each.new))
            yield f"{each.change:<17} {each.signature} ({rates} fresh trials)"
        for name, one in (("old", self.old), ("new", self.new)):
            yield f"{name}: {one.hits} of {one.total} trials failed, 95 %: {one.low:.1%} to {one.high:.1%}"


def compare(old: Path, new: Path) -> Comparison:
    """Compare two output folders of `riot test`.

    Args:
        old: The older one.
        new: The newer one.

    Raises:
        ConfigError: One holds no finished campaign.
    """
    before, after = CampaignRecord.load(old), CampaignRecord.load(new)
    earlier, later = _findings(old, before), _findings(new, after)
    order: dict[Change, int] = {
        "new": 0,
        "comes more often": 1,
        "still failing": 2,
        "comes less often": 3,
        "not seen": 4,
    }
    found = []
    for signature in earlier.keys() | later.keys():
        one, other = earlier.get(signature), later.get(signature)
        known = other or one
        assert known is not None
        was, now = one.rate if one else None, other.rate if other else None
        found.append(ComparedFinding(signature, known.severity, _change(one, other), was, now))
    found.sort(key=lambda each: (order[each.change], each.signature))
    return Comparison(after.unit, _share(before), _share(after), tuple(found))


def _findings(folder: Path, campaign: CampaignRecord) -> dict[str, FindingRecord]:
    records = [FindingRecord.load(folder / "findings" / name) for name in campaign.findings]
    return {record.signature: record for record in records}


def _share(campaign: CampaignRecord) -> Proportion:
    return proportion(campaign.failing, campaign.tested)


def _change(old: FindingRecord | None, new: FindingRecord | None) -> Change:
    if old is None:
        return "new"
    if new is None:
        return "not seen"
    if old.rate and new.rate and new.rate.low > old.rate.high:
        return "comes more often"
    if old.rate and new.rate and new.rate.high < old.rate.low:
        return "comes less often"
    return "still failing"
