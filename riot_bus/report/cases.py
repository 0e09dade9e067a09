"""A campaign as test cases, for formats that know tests: the nominal log, the campaign, and each finding.

Each unit is a suite. Its cases keep their names from run to run: findings are named by their signature.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from riot_bus.findings.known import title_of
from riot_bus.findings.records import CampaignRecord
from riot_bus.report.campaign_view import CampaignView
from riot_bus.report.finding_view import FindingView
from riot_bus.report.format import clean
from riot_bus.report.location import find_place, unit_place
from riot_bus.report.text import TextReport
from riot_bus.vocabulary.counting import counted

LONGEST_NAME = 300
"""It tells cases apart, and signatures with 100 characters of source mostly fit."""
LONGEST_LINE = 600
"""Of what lists of failures show; `as_text` gives the whole text."""


@dataclass(frozen=True, slots=True)
class ReportedCase:
    """A test case.

    Attributes:
        name: Its name, the same in each run.
        result: Result of the case; `error` if the unit is not at fault.
        kind: Kind of failure, of error, or why it was skipped.
        message: Summary of what happened, in a line; it may contain untrusted text, as all other texts.
        seconds: Duration; None if that is not known.
    """

    name: str
    result: Literal["passed", "failure", "error", "skipped"] = "passed"
    kind: str = ""
    message: str = ""
    lines: Sequence[str] = ()
    told: Sequence[str] = ()
    seconds: float | None = None

    @property
    def line(self) -> str:
        """The message, safe and bounded."""
        return clean(self.message, limit=LONGEST_LINE)

    @property
    def text(self) -> str:
        """All that is known of the result, safe and bounded."""
        return as_text(self.lines) or self.line


def as_text(lines: Iterable[str]) -> str:
    """Return lines as a text, safe and bounded."""
    return "\n".join(clean(line, limit=4000, lines=True).rstrip() for line in list(lines)[:200])


def suites_of(view: CampaignView) -> list[str]:
    """Return the names of the units that are suites."""
    return list(dict.fromkeys([*([view.unit] if not view.alone else []), *(one.finding.unit for one in view.findings)]))


def findings_of(view: CampaignView, unit: str) -> list[FindingView]:
    """Return the findings of a unit."""
    return [one for one in view.findings if one.finding.unit == unit]


def cases_of(view: CampaignView, unit: str) -> list[ReportedCase]:
    """Return the cases of a unit; those of the nominal log and the campaign come first, if it is the one tested."""
    own = [_nominal_case(view), _campaign_case(view)] if unit == view.unit and not view.alone else []
    return [*own, *(_finding_case(view, one) for one in findings_of(view, unit))]


def _nominal_case(view: CampaignView) -> ReportedCase:
    campaign, name = view.campaign, "nominal log"
    if campaign is None:
        why = "not known before the campaign has ended"
        return ReportedCase(name, "skipped", message=why, lines=[view.verdict])
    rates = [(one.finding, one.finding.nominal) for one in view.current if one.finding.unit == campaign.unit]
    failing = [
        f"{rate.count} of {counted(rate.total, 'trial')} of the nominal log failed: {finding.signature}"
        for finding, rate in rates
        if rate and rate.count
    ]
    if failing:
        return ReportedCase(name, "failure", "nominal", failing[0], failing)
    if doubts := _nominal_doubts(campaign):
        return ReportedCase(name, "skipped", "inconclusive", doubts[0], doubts)
    return ReportedCase(name)


def _campaign_case(view: CampaignView) -> ReportedCase:
    campaign, name = view.campaign, "campaign"
    if campaign is None:
        kind = "environment" if view.excused else "not finished"
        return ReportedCase(name, "error", kind, view.verdict, [*view.remarks, *view.doubts])
    unconfirmed = [f"not confirmed: {one.signature}" for one in campaign.unconfirmed]
    untold = [f"not told: {each}" for each in campaign.untold]
    told = [view.verdict, *view.remarks, *unconfirmed, *untold, *campaign.effects.lines()]
    result: Literal["passed", "error", "skipped"] = "passed"
    kind, lines = "", list[str]()
    if view.problem or campaign.unjudged or view.broken:
        result, kind, lines = "error", "environment", [*([view.problem] if view.problem else []), *view.doubts]
    elif view.doubts:
        result, kind, lines = "skipped", "inconclusive", view.doubts
    elif campaign.stopped:
        result, kind, lines = "skipped", "ended early", [campaign.stopped]
    return ReportedCase(name, result, kind, view.verdict, lines, told, campaign.seconds)


def _nominal_doubts(campaign: CampaignRecord) -> list[str]:
    """Return what trials of the nominal log have shown besides findings: alarms, and unconfirmed failures."""
    alarms = [f"not told: {each}" for each in campaign.untold if each.endswith(" show the same")]
    own = [each.signature for each in campaign.unconfirmed if not each.injections]
    return [*alarms, *(f"failed in a trial of the nominal log, not confirmed: {each}" for each in own)]


def _finding_case(view: CampaignView, one: FindingView) -> ReportedCase:
    """Return the case of a finding; it took as long as the steps that explained it."""
    finding, name = one.finding, clean(title_of(one.finding), limit=LONGEST_NAME)
    seconds = sum(record.seconds for step, record in one.steps if record and step.name != "test")
    if one not in view.current and finding.fixed_in and finding.fixed_in == view.fingerprint:
        told = ["fixed: fresh trials of its log do not fail any more", one.command("reproduce")]
        return ReportedCase(name, told=told, seconds=seconds)
    if one not in view.current:
        why = "found with other code or another riot.toml, and not seen by this campaign"
        lines = [why, one.command("reproduce")]
        return ReportedCase(name, "skipped", "earlier", why, lines, seconds=seconds)
    place, unit = find_place(one), unit_place(finding)
    about = [f"at {place}", f"unit {finding.unit} of {unit}", *finding.details[:1], TextReport().render(one)]
    if view.standing(one) == "known":
        lines = [one.verdict_text, *about]
        return ReportedCase(name, "skipped", "known", view.told(one), lines, seconds=seconds)
    lines = [*([view.told(one)] if view.entry(one) else []), *about]
    return ReportedCase(name, "failure", finding.monitor, one.verdict_text, lines, seconds=seconds)
