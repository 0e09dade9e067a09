"""A campaign as JUnit's XML, in the dialect xunit2 that Jenkins, GitLab, colcon and others read.

Each unit is a suite, whose cases keep their names from run to run: the nominal log, the campaign, and each finding by
its signature. In xunit2 only a suite may have `file` and properties, so it holds riot.toml and the figures.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from xml.etree import ElementTree

import riot_bus
from riot_bus.report.campaign_view import CampaignView
from riot_bus.report.cases import LONGEST_LINE, LONGEST_NAME, ReportedCase, as_text, cases_of, findings_of, suites_of
from riot_bus.report.finding_view import FindingView
from riot_bus.report.format import clean, share_interval
from riot_bus.report.location import find_place, unit_place


class JunitReport:
    """The report format `junit`."""

    file = "riot.xunit.xml"

    def render_campaign(self, view: CampaignView) -> str:
        """Return the document; untrusted texts stay text, and what XML cannot hold is escaped."""
        suites = [_suite(view, unit) for unit in suites_of(view)]
        sums = {name: sum(int(each.attrib[name]) for each in suites) for name in ("tests", "failures", "errors")}
        seconds = sum(float(each.attrib["time"]) for each in suites)
        totals = {name: str(count) for name, count in sums.items()} | {"time": f"{seconds:.3f}"}
        root = ElementTree.Element("testsuites", {"name": "riot", **totals})
        root.extend(suites)
        ElementTree.indent(root)
        return f'<?xml version="1.0" encoding="utf-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _suite(view: CampaignView, unit: str) -> ElementTree.Element:
    name = clean(unit, limit=LONGEST_NAME) or "riot"
    findings, cases = findings_of(view, unit), cases_of(view, unit)
    suite = ElementTree.Element("testsuite", name=name)
    source = findings[0].finding if findings else view.campaign
    if source is not None and source.system_file:
        suite.set("file", unit_place(source).path)
    properties = ElementTree.SubElement(suite, "properties")
    for key, value in _properties(view, findings, of_it=unit == view.unit and not view.alone):
        ElementTree.SubElement(properties, "property", name=key, value=value)
    for case in cases:
        _add(suite, case, f"riot.{name}")
    suite.attrib |= {**_counts(suite.iter("testcase")), "time": f"{sum(each.seconds or 0.0 for each in cases):.3f}"}
    return suite


def _add(suite: ElementTree.Element, case: ReportedCase, classname: str) -> None:
    element = ElementTree.SubElement(suite, "testcase", classname=classname, name=case.name)
    if case.seconds is not None:
        element.set("time", f"{case.seconds:.3f}")
    if case.result != "passed":
        about = {"type": clean(case.kind, limit=100)} if case.kind else {}
        ElementTree.SubElement(element, case.result, {"message": case.line, **about}).text = case.text
    if case.told:
        ElementTree.SubElement(element, "system-out").text = as_text(case.told)


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
        facts = one.facts() | {"place": str(find_place(one))}
        if rate := one.finding.rate:
            facts["rate"] = f"{rate.count} of {rate.total} ({share_interval(rate.low, rate.high)})"
        name = clean(one.directory.name, limit=100)
        yield from ((f"{name}.{key}", clean(told, limit=LONGEST_LINE)) for key, told in facts.items())


def _counts(cases: Iterable[ElementTree.Element]) -> dict[str, str]:
    """Return the number of cases, and how many of them failed, had an error or were skipped."""
    cases = list(cases)
    ends = {"failures": "failure", "errors": "error", "skipped": "skipped"}
    found = {name: sum(case.find(tag) is not None for case in cases) for name, tag in ends.items()}
    return {name: str(count) for name, count in ({"tests": len(cases)} | found).items()}
