"""A campaign as JUnit's XML, in the dialect xunit2 that Jenkins, GitLab, colcon and others read.

Each unit is a suite, whose cases keep their names from run to run: the nominal log, the campaign, and each finding by
its signature. In xunit2 only a suite may have `file` and properties, so it holds riot.toml and the figures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree

import riot_bus
from riot_bus.findings.known import title_of
from riot_bus.report.format import clean, share_interval
from riot_bus.report.location import find_place, unit_place
from riot_bus.report.text import TextReport
from riot_bus.vocabulary.counting import counted

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from riot_bus.findings.records import CampaignRecord
    from riot_bus.report.campaign_view import CampaignView
    from riot_bus.report.finding_view import FindingView

__all__ = ["JunitReport"]

_LONGEST_NAME = 300  # it tells cases apart, and signatures with 100 characters of source mostly fit
_LONGEST_LINE = 600  # for attributes, which lists of failures show; the element has the whole text
_MOST_LINES = 200  # of up to 4,000 characters each: a text stays below 1 MB


class JunitReport:
    """The report format `junit`."""

    file = "riot.xunit.xml"

    def render_campaign(self, view: CampaignView) -> str:
        """Return the document; untrusted texts stay text, and what XML cannot hold is escaped."""
        units = dict.fromkeys([*([view.unit] if not view.alone else []), *(one.finding.unit for one in view.findings)])
        suites = [_suite(view, unit) for unit in units]
        root = ElementTree.Element("testsuites", {"name": "riot", **_totals(suites)})
        root.extend(suites)
        ElementTree.indent(root)
        return f'<?xml version="1.0" encoding="utf-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _suite(view: CampaignView, unit: str) -> ElementTree.Element:
    name = clean(unit, limit=_LONGEST_NAME) or "riot"
    findings = [one for one in view.findings if one.finding.unit == unit]
    of_it = unit == view.unit and not view.alone
    suite = ElementTree.Element("testsuite", name=name)
    source = findings[0].finding if findings else view.campaign
    if source is not None and source.system_file:
        suite.set("file", unit_place(source).path)
    properties = ElementTree.SubElement(suite, "properties")
    for key, value in _properties(view, findings, of_it=of_it):
        ElementTree.SubElement(properties, "property", name=key, value=value)
    seconds = _campaign_cases(suite, view, f"riot.{name}") if of_it else 0.0
    seconds += sum(_finding_case(suite, view, one, f"riot.{name}") for one in findings)
    suite.attrib |= {**_counts(suite.iter("testcase")), "time": f"{seconds:.3f}"}
    return suite


def _campaign_cases(suite: ElementTree.Element, view: CampaignView, classname: str) -> float:
    """Add the cases of the nominal log and the campaign; return the seconds that the campaign took."""
    campaign = view.campaign
    nominal = ElementTree.SubElement(suite, "testcase", classname=classname, name="nominal log")
    case = ElementTree.SubElement(suite, "testcase", classname=classname, name="campaign")
    if campaign is None:
        _add(nominal, "skipped", "not known before the campaign has ended", [view.verdict])
        kind = "environment" if view.excused else "not finished"
        _add(case, "error", view.verdict, [*view.remarks, *view.doubts], kind=kind)
        return 0.0
    case.set("time", f"{campaign.seconds:.3f}")
    rates = [(one.finding, one.finding.nominal) for one in view.current if one.finding.unit == campaign.unit]
    failing = [
        f"{rate.count} of {counted(rate.total, 'trial')} of the nominal log failed: {finding.signature}"
        for finding, rate in rates
        if rate and rate.count
    ]
    if failing:
        _add(nominal, "failure", failing[0], failing, kind="nominal")
    elif doubts := _nominal_doubts(campaign):
        _add(nominal, "skipped", doubts[0], doubts, kind="inconclusive")
    if view.problem or campaign.unjudged or view.broken:
        _add(case, "error", view.verdict, [*([view.problem] if view.problem else []), *view.doubts], kind="environment")
    elif view.doubts:
        _add(case, "skipped", view.verdict, view.doubts, kind="inconclusive")
    elif campaign.stopped:
        _add(case, "skipped", view.verdict, [campaign.stopped], kind="ended early")
    unconfirmed = [f"not confirmed: {one.signature}" for one in campaign.unconfirmed]
    untold = [f"not told: {each}" for each in campaign.untold]
    told = ElementTree.SubElement(case, "system-out")
    told.text = _lines([view.verdict, *view.remarks, *unconfirmed, *untold, *campaign.effects.lines()])
    return campaign.seconds


def _nominal_doubts(campaign: CampaignRecord) -> list[str]:
    """Return what trials of the nominal log have shown besides findings: alarms, and unconfirmed failures."""
    alarms = [f"not told: {each}" for each in campaign.untold if each.endswith(" show the same")]
    own = [each.signature for each in campaign.unconfirmed if not each.injections and not each.history]
    return [*alarms, *(f"failed in a trial of the nominal log, not confirmed: {each}" for each in own)]


def _finding_case(suite: ElementTree.Element, view: CampaignView, one: FindingView, classname: str) -> float:
    """Add the case of a finding; return the seconds of the steps that explained it."""
    finding, name = one.finding, clean(title_of(one.finding), limit=_LONGEST_NAME)
    seconds = sum(record.seconds for step, record in one.steps if record and step.name != "test")
    case = ElementTree.SubElement(suite, "testcase", classname=classname, name=name, time=f"{seconds:.3f}")
    if one not in view.current and finding.fixed_in and finding.fixed_in == view.fingerprint:
        told = ElementTree.SubElement(case, "system-out")
        told.text = _lines(["fixed: fresh trials of its log do not fail any more", one.command("reproduce")])
        return seconds
    if one not in view.current:
        why = "found with other code or another riot.toml, and not seen by this campaign"
        _add(case, "skipped", why, [why, one.command("reproduce")], kind="earlier")
        return seconds
    verdict = "".join(part.text for part in one.verdict())
    place, unit = find_place(one), unit_place(finding)
    lines = [f"at {place}", f"unit {finding.unit} of {unit}", *finding.details[:1], TextReport().render(one)]
    if view.standing(one) == "known":
        _add(case, "skipped", view.told(one), [verdict, *lines], kind="known")
    else:
        back = [view.told(one)] if view.entry(one) else []
        _add(case, "failure", verdict, [*back, *lines], kind=finding.monitor)
    return seconds


def _properties(view: CampaignView, findings: Iterable[FindingView], *, of_it: bool) -> Iterator[tuple[str, str]]:
    yield "riot.version", riot_bus.__version__
    campaign = view.campaign
    if campaign and of_it:
        yield "riot.fingerprint", clean(campaign.fingerprint)
        yield from (("riot.seed", str(campaign.seed)), ("riot.trials", str(campaign.tested)))
        yield "riot.failing", str(campaign.failing)
        yield "riot.covered", f"{campaign.covered} of {campaign.coverable}"
        yield "riot.unconfirmed", str(len(campaign.unconfirmed))
    for one in findings:
        finding, rate = one.finding, one.finding.rate
        facts = {
            "signature": finding.signature,
            "place": str(find_place(one)),
            "severity": finding.severity,
            "reach": one.severity,
            "rate": f"{rate.count} of {rate.total} ({share_interval(rate.low, rate.high)})" if rate else "",
            "rule": one.rule.text if one.rule else "",
            "reproduce": one.command("reproduce"),
        }
        name = clean(one.directory.name, limit=100)
        yield from ((f"{name}.{key}", clean(told, limit=_LONGEST_LINE)) for key, told in facts.items() if told)


def _add(case: ElementTree.Element, tag: str, message: str, lines: Iterable[str], *, kind: str = "") -> None:
    about = {"type": clean(kind, limit=100)} if kind else {}
    told = clean(message, limit=_LONGEST_LINE)
    ElementTree.SubElement(case, tag, {"message": told, **about}).text = _lines(lines) or told


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(clean(line, limit=4000, lines=True).rstrip() for line in list(lines)[:_MOST_LINES])


def _counts(cases: Iterable[ElementTree.Element]) -> dict[str, str]:
    """Return the number of cases, and how many of them failed, had an error or were skipped."""
    cases = list(cases)
    ends = {"failures": "failure", "errors": "error", "skipped": "skipped"}
    found = {name: sum(case.find(tag) is not None for case in cases) for name, tag in ends.items()}
    return {name: str(count) for name, count in ({"tests": len(cases)} | found).items()}


def _totals(suites: Iterable[ElementTree.Element]) -> dict[str, str]:
    suites = list(suites)
    sums = {name: sum(int(each.attrib[name]) for each in suites) for name in ("tests", "failures", "errors")}
    seconds = sum(float(each.attrib["time"]) for each in suites)
    return {name: str(count) for name, count in sums.items()} | {"time": f"{seconds:.3f}"}
