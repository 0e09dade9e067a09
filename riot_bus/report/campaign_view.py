"""View of a campaign that all reports share: its record, if it has ended, its findings, and the verdict on both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from riot_bus.findings.known import KnownFinding, fingerprint_of
from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.report.finding_view import FindingView, load
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError

Standing = Literal["", "new", "known", "came back"]
"""Status of a finding in a baseline: empty without a baseline; `came back` if it was fixed and fails again."""

_FINDINGS = "findings"
_GRAVE = ("catastrophic", "restart", "abort")


@dataclass(frozen=True, slots=True)
class CampaignView:
    """A campaign in its present state.

    Attributes:
        folder: Its output folder, as the user gave it; for a single finding, that finding's folder.
        campaign: Its record; None before it has ended, and for a single finding.
        findings: All findings of the folder, the worst first.
        broken: Records that cannot be used, with the reason.
        unit: Unit under test; empty if that is not known.
        fingerprint: Fingerprint of the code and riot.toml under test; empty if that is not known.
        problem: Reason why the work ended early; empty if it did not.
        alone: Whether this is a single finding, without the rest of its campaign.
        known: The baseline by fingerprint; None if there is none, so that every finding counts.
        remarks: Further remarks, such as which known findings no longer fail.
        excused: Whether the work ended early by a fault of the environment that does not count as a failure.
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
        """Return the entry of a finding in the baseline."""
        return None if self.known is None else self.known.get(fingerprint_of(one.finding))

    def standing(self, one: FindingView) -> Standing:
        """Return the status of a finding in the baseline."""
        if self.known is None:
            return ""
        entry = self.entry(one)
        return "new" if entry is None else "came back" if entry.fixed else "known"

    @property
    def failures(self) -> tuple[FindingView, ...]:
        """The findings of the code under test that count: all that the baseline does not know."""
        return tuple(one for one in self.current if self.standing(one) != "known")

    def told(self, one: FindingView) -> str:
        """Return the status of a finding in a few words; it may contain text that users wrote."""
        entry, standing = self.entry(one), self.standing(one)
        return standing if entry is None else f"{standing}: {entry.told}"

    @property
    def doubts(self) -> list[str]:
        """Why nothing can be concluded where nothing was found."""
        unusable = [f"{name} cannot be used: {why}" for name, why in self.broken.items()]
        return [*unusable, *(self.campaign.doubts if self.campaign else ())]

    @property
    def verdict(self) -> str:
        """Result of the campaign in a line; it may contain untrusted text."""
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
    """Read what exists of a campaign; the view lists what cannot be used.

    Args:
        finished: Whether `campaign.json`, if it exists, is of this campaign and not of an earlier one.
    """
    broken: dict[str, str] = {}
    campaign, findings = None, list[FindingView]()
    if finished and CampaignRecord.exists(folder):
        try:
            campaign = CampaignRecord.load(folder)
        except ConfigError as error:
            broken[CampaignRecord.FILE] = error.message
    for one in FindingRecord.folders(folder / _FINDINGS):
        try:
            findings.append(load(one))
        except ConfigError as error:
            broken[f"{_FINDINGS}/{one.name}/{FindingRecord.FILE}"] = error.message
    for name in campaign.findings if campaign else ():
        if not FindingRecord.exists(folder / _FINDINGS / name):
            broken[f"{_FINDINGS}/{name}"] = "it is not there"
    findings.sort(key=lambda one: one.finding.rank)
    if campaign is not None:
        unit, fingerprint = campaign.unit, campaign.fingerprint
    unit = unit or (findings[0].finding.unit if findings else "")
    return CampaignView(folder, campaign, tuple(findings), broken, unit, fingerprint, problem)


def as_campaign(view: FindingView | CampaignView) -> CampaignView:
    """Return a campaign view; that of a single finding has found nothing else."""
    if isinstance(view, CampaignView):
        return view
    return CampaignView(view.directory, None, (view,), unit=view.finding.unit, alone=True)


def is_output_folder(path: Path) -> bool:
    """Return whether a folder is that of a campaign, not of one finding."""
    return not FindingRecord.exists(path) and (CampaignRecord.exists(path) or (path / _FINDINGS).is_dir())


def level_of(finding: FindingRecord) -> Literal["error", "warning"]:
    """Return the level of a finding, for programs that know two levels, from its place on the CRASH scale."""
    return "error" if finding.severity in _GRAVE else "warning"
