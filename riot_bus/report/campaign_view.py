"""All that is known of a campaign: its record, if it has ended, its findings, and what follows from both."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from riot_bus.findings.records import CampaignRecord, FindingRecord
from riot_bus.report.finding_view import FindingView, load
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["CampaignView", "is_output_folder", "level_of", "load_campaign", "title_of", "view_of_one"]

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
    """

    folder: Path
    campaign: CampaignRecord | None
    findings: tuple[FindingView, ...]
    broken: Mapping[str, str] = field(default_factory=dict)
    unit: str = ""
    fingerprint: str = ""
    problem: str = ""
    alone: bool = False

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
            found = counted(len(current), "finding") + (f" of {self.unit}" if self.unit else "")
            why = f" ({self.problem})" if self.problem else ""
            return found if self.alone else f"not finished{why}: {found} so far"
        noun, of = ("run", "the whole system") if campaign.whole_system else ("trial", campaign.unit)
        tested = f"{counted(campaign.tested, noun)} of {of}"
        own = [one for one in current if one.directory.name in campaign.findings]
        told = f"{counted(len(own), 'finding') if own else 'no finding'} in {tested}"
        if not own and self.doubts:
            first, *others = self.doubts
            more = f" (and {counted(len(others), 'more doubt')})" if others else ""
            told = f"inconclusive: {told}, but {first}{more}"
        if len(current) > len(own):
            told += f"; {counted(len(current) - len(own), 'more finding')} of the same code, found otherwise"
        return told + (f"; then it stopped: {self.problem}" if self.problem else "")


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


def title_of(finding: FindingRecord) -> str:
    """Return what a finding is called from one campaign to the next: its signature, and what else tells it apart."""
    marks = {"whole system": finding.whole_system, "messages missing": finding.id.endswith("-missing")}
    return finding.signature + "".join(f" ({mark})" for mark, so in marks.items() if so)


def level_of(finding: FindingRecord) -> Literal["error", "warning"]:
    """Return how grave a finding is in the words of programs that know two: by its place on the CRASH scale."""
    return "error" if finding.severity in _GRAVE else "warning"
