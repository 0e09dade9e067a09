"""Results of `riot ci change` and `riot ci batch`, for people, programs and builds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.findings.known import fingerprint_of, title_of
from riot_bus.report.format import clean
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import EnvironmentFaultError, InconclusiveError

if TYPE_CHECKING:
    from riot_bus.report.campaign_view import CampaignView
    from riot_bus.report.finding_view import FindingView

__all__ = ["CiResult", "UnitResult"]


@dataclass(frozen=True, slots=True)
class UnitResult:
    """Result of a unit.

    Attributes:
        view: Campaign and findings of the unit, compared with the baseline.
        undecided: Findings whose replay does not decide whether they are back.
        untested: Why the unit was not tested, or not to the end; empty if it was.
    """

    unit: str
    view: CampaignView
    undecided: tuple[str, ...] = ()
    untested: str = ""

    @property
    def doubts(self) -> list[str]:
        """Why a test without findings would be inconclusive."""
        return [*self.undecided, *self.view.doubts]

    def lines(self) -> list[str]:
        """Return the result for people."""
        found = [f"{self.unit}: {self.view.verdict}"]
        for one in sorted(self.view.current, key=lambda one: self.view.standing(one) == "known"):
            standing, entry, rate = self.view.standing(one), self.view.entry(one), one.finding.rate
            often = f" ({rate.count} of {counted(rate.total, 'fresh trial')})" if rate else ""
            found.append(f"  {standing}: {title_of(one.finding)}{often}{f', {entry.told}' if entry else ''}")
            found += [f"    {one.command('reproduce')}"] if standing != "known" else []
        found += [f"  {remark}" for remark in self.view.remarks]
        return [clean(line, limit=1000) for line in found]

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        findings = [
            {
                "folder": str(one.directory),
                "title": title_of(one.finding),
                "fingerprint": fingerprint_of(one.finding),
                "standing": self.view.standing(one),
            }
            for one in self.view.current
        ]
        told = {"verdict": self.view.verdict, "remarks": list(self.view.remarks), "doubts": self.doubts}
        return {"unit": self.unit, "untested": self.untested, **told, "findings": findings}


@dataclass(frozen=True, slots=True)
class CiResult:
    """Results of all units."""

    units: tuple[UnitResult, ...]

    @property
    def failures(self) -> list[FindingView]:
        """The findings that count: those not in the baseline, or marked as fixed there."""
        return [one for unit in self.units for one in unit.view.failures]

    def exit_code(self, *, strict: bool) -> int:
        """Return 1 if findings count; if strict, the code for units not tested or not decided; else 0."""
        if self.failures:
            return 1
        untested = any(unit.untested for unit in self.units)
        doubtful = any(unit.doubts for unit in self.units)
        if not strict or not (untested or doubtful):
            return 0
        return EnvironmentFaultError.exit_code if untested else InconclusiveError.exit_code

    def warnings(self) -> list[str]:
        """Return what was not tested, or not decided, for people."""
        found = [f"not tested: {unit.unit}: {unit.untested}" for unit in self.units if unit.untested]
        doubts = [(unit, each) for unit in self.units if not unit.untested for each in unit.doubts]
        return found + [f"inconclusive: {unit.unit}: {each}" for unit, each in doubts]

    def lines(self) -> list[str]:
        """Return all of it for people."""
        count = len(self.failures)
        last = f"{counted(count, 'finding')} that the baseline does not know" if count else "no new finding"
        untested = sum(bool(unit.untested) for unit in self.units)
        last += f"; {untested} of {counted(len(self.units), 'unit')} not tested" if untested else ""
        return [*(line for unit in self.units for line in unit.lines()), last]
