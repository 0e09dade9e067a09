"""All that is known of a campaign: its record, if it has ended, its findings, and what follows from both."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from riot_bus.findings.known import fingerprint_of
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.report.finding_view import FindingView, load
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.findings.known import KnownFinding

__all__ = ["CampaignView", "Standing", "is_output_folder", "level_of", "load_campaign", "view_of_one"]

Standing = Literal["", "new", "known", "came back"]
"""What a baseline says of a finding: nothing, as there is none; or that it was said to be fixed, and fails again."""

_FINDINGS = "findings"
_GRAVE = ("catastrophic", "restart", "abort")


@dataclass(frozen=True, slots=True)
class CampaignView:
    """A campaign as far as it has come.

    Attributes:
        folder: Its output folder, as the user gave it; of one finding alone, that finding's.
        campaign: Its record; None before it has ended, and of one finding alone.
        findings: All findings of the folder, the worst first.
        broken: What is there and cannot be used, with the reason.
        unit: Unit under test; empty if that is not known.
        fingerprint: Of the code and riot.toml under test; empty if that is not known.
        problem: Why the work ended early; empty if it did not.
        alone: Whether this is one finding, whatever else its campaign has come to.
        known: The baseline by fingerprint; None if there is none, so that every finding counts.
        remarks: What else was learnt, such as which known findings no longer fail.
        excused: Whether what ended the work early is no failure of the code, nor of those who run it.
    """

    folder: Path
    campaign: CampaignRecord | None
    findings: tuple[FindingView, ...]
    broken: Mapping[str, str] = field(default_factory=dict)
    unit: str = ""
    fingerprint: str = ""
    problem: str = ""
    alone: bool = False
    known: Mapping[str, KnownFinding] | None = None
    remarks: tuple[str, ...] = ()
    excused: bool = False

    @property
    def finished(self) -> bool:
        """Whether the campaign has ended, as far as it matters for what is shown."""
        return self.alone or self.campaign is not None

    @property
    def current(self) -> tuple[FindingView, ...]:
        """The findings of the code under test."""
        return tuple(one for one in self.findings if self._is_current(one))

    @property
    def earlier(self) -> tuple[FindingView, ...]:
        """The findings of other code, or another riot.toml, that this campaign has not seen again."""
        return tuple(one for one in self.findings if not self._is_current(one))

    def _is_current(self, one: FindingView) -> bool:
        return not self.fingerprint or one.finding.fingerprint in ("", self.fingerprint)

    def entry(self, one: FindingView) -> KnownFinding | None:
        """Return what the baseline has of a finding."""
        return None if self.known is None else self.known.get(fingerprint_of(one.finding))

    def standing(self, one: FindingView) -> Standing:
        """Return what the baseline says of a finding."""
        if self.known is None:
            return ""
        entry = self.entry(one)
        return "new" if entry is None else "came back" if entry.fixed else "known"

    @property
    def failures(self) -> tuple[FindingView, ...]:
        """The findings of the code under test that count: all that the baseline does not know."""
        return tuple(one for one in self.current if self.standing(one) != "known")

    def told(self, one: FindingView) -> str:
        """Return what the baseline says of a finding, in a few words; what people wrote stands in it."""
        entry, standing = self.entry(one), self.standing(one)
        return standing if entry is None else f"{standing}: {entry.told}"

    @property
    def doubts(self) -> list[str]:
        """Why nothing can be concluded where nothing was found."""
        unusable = [f"{name} cannot be used: {why}" for name, why in self.broken.items()]
        return [*unusable, *(self.campaign.doubts if self.campaign else ())]

    @property
    def verdict(self) -> str:
        """What the campaign has come to, in a line; texts in it come from others."""
        current, campaign = self.current, self.campaign
        if campaign is None:
            found = self._counted(current) + (f" of {self.unit}" if self.unit else "")
            if self.excused:
                return f"not tested: {self.problem}" + (f"; {found} so far" if current else "")
            why = f" ({self.problem})" if self.problem else ""
            return found if self.alone else f"not finished{why}: {found} so far"
        noun, of = ("run", "the whole system") if campaign.whole_system else ("trial", campaign.unit)
        tested = f"{counted(campaign.tested, noun)} of {of}"
        own = [one for one in current if one.directory.name in campaign.findings]
        told = f"{self._counted(own) if own else 'no finding'} in {tested}"
        if not own and self.doubts:
            first, *others = self.doubts
            more = f" (and {counted(len(others), 'more doubt')})" if others else ""
            told = f"inconclusive: {told}, but {first}{more}"
        if len(current) > len(own):
            rest = [one for one in current if one not in own]
            told += f"; {self._counted(rest, more='more ')} of the same code, found otherwise"
        told += f"; ended early: {campaign.stopped}" if campaign.stopped else ""
        return told + (f"; then it stopped: {self.problem}" if self.problem else "")

    def _counted(self, some: Sequence[FindingView], *, more: str = "") -> str:
        """Return how many findings these are, and how many of them count where there is a baseline."""
        count = sum(self.standing(one) != "known" for one in some)
        mixed = 0 < count < len(some)
        kind = "" if self.known is None or mixed or not some else "new " if count else "known "
        return counted(len(some), f"{more}{kind}finding") + (f" ({count} new)" if mixed else "")


def load_campaign(
    folder: Path, *, finished: bool = True, unit: str = "", fingerprint: str = "", problem: str = ""
) -> CampaignView:
    """Read what there is of a campaign; what cannot be used is told in the view.

    Args:
        folder: Its output folder.
        finished: Whether `campaign.json` is of this campaign, if it is there, not of one before it.
        unit: Unit under test, before it is in a record.
        fingerprint: Of what is tested, likewise.
        problem: Why the work has ended early; empty if it has not.
    """
    broken: dict[str, str] = {}
    campaign, findings = None, list[FindingView]()
    if finished and CampaignRecord.exists(folder):
        try:
            campaign = CampaignRecord.load(folder)
        except ConfigError as error:
            broken[CampaignRecord.FILE] = error.message
    for path in sorted((folder / _FINDINGS).glob(f"*/{FindingRecord.FILE}")):
        try:
            findings.append(load(path.parent))
        except ConfigError as error:
            broken[f"{_FINDINGS}/{path.parent.name}/{path.name}"] = error.message
    for name in campaign.findings if campaign else ():
        if not FindingRecord.exists(folder / _FINDINGS / name):
            broken[f"{_FINDINGS}/{name}"] = "it is not there"
    findings.sort(key=lambda one: one.finding.rank)
    if campaign is not None:
        unit, fingerprint = campaign.unit, campaign.fingerprint
    unit = unit or (findings[0].finding.unit if findings else "")
    return CampaignView(folder, campaign, tuple(findings), broken, unit, fingerprint, problem)


def view_of_one(view: FindingView) -> CampaignView:
    """Return one finding as formats of campaigns take it."""
    return CampaignView(view.directory, None, (view,), unit=view.finding.unit, alone=True)


def is_output_folder(path: Path) -> bool:
    """Return whether a folder is that of a campaign, not of one finding."""
    return not FindingRecord.exists(path) and (CampaignRecord.exists(path) or (path / _FINDINGS).is_dir())


def level_of(finding: FindingRecord) -> Literal["error", "warning"]:
    """Return how grave a finding is in the words of programs that know two: by its place on the CRASH scale."""
    return "error" if finding.severity in _GRAVE else "warning"
