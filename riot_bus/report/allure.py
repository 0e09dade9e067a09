"""A campaign as results for Allure: a folder with a file for each case, and the logs and pages of findings beside them.

Cases are those of `cases`. Their identifiers follow from unit and name, so Allure recognises them in later runs, and a
case that is reported again replaces its file. Other files in the folder stay: other tools may have written them.
"""

from __future__ import annotations

import hashlib
import json
import uuid
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from riot_bus.findings.records import CampaignRecord, FindingRecord, shortest_log
from riot_bus.report.cases import LONGEST_NAME, as_text, cases_of, suites_of
from riot_bus.report.format import clean
from riot_bus.report.location import find_place
from riot_bus.report.markdown import MarkdownReport, code
from riot_bus.report.page import PAGE, HtmlReport
from riot_bus.vocabulary.errors import MissingExtraError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from riot_bus.report.campaign_view import CampaignView
    from riot_bus.report.cases import ReportedCase
    from riot_bus.report.finding_view import FindingView
    from riot_bus.report.formats import Content

_SPACE = uuid.UUID("0d3b1d1c-2c0b-5e0e-9a8e-6a1f6b1b6f5e")
"""Any constant, so that the same case has the same file each time."""
_STATUS = {"passed": "passed", "failure": "failed", "error": "broken", "skipped": "skipped"}
_SEVERITY = {
    "catastrophic": "blocker",
    "restart": "critical",
    "abort": "critical",
    "silent": "normal",
    "hindering": "minor",
}
"""Allure's word for each place on the CRASH scale."""
_LARGEST = 64 << 20
"""Bytes of a log that is attached; a longer one is none that a person opens from a report."""


class AllureReport:
    """The report format `allure`."""

    file = "allure-results"

    def render_campaign(self, view: CampaignView) -> Content:
        """Return the files; untrusted texts stay text, and files of findings are copied."""
        files: dict[str, str | bytes | Path] = {}
        for unit in suites_of(view):
            suite = clean(unit, limit=LONGEST_NAME) or "riot"
            for case in cases_of(view, unit):
                name = f"riot.{suite}.{case.name}"
                identity = uuid.uuid5(_SPACE, name)
                attachments = []
                for suffix, content, title, kind in _attached(case.finding) if case.finding else ():
                    source = f"{uuid.uuid5(identity, suffix)}-attachment{suffix}"
                    files[source] = content
                    attachments.append({"name": title, "source": source, "type": kind})
                told = _result(view, case, suite, name) | {"uuid": str(identity), "attachments": attachments}
                files[f"{identity}-result.json"] = json.dumps(told, indent=1) + "\n"
        return files


def _result(view: CampaignView, case: ReportedCase, suite: str, name: str) -> dict[str, Any]:
    known = hashlib.sha256(name.encode(errors="backslashreplace")).hexdigest()
    found: dict[str, Any] = {"historyId": known, "testCaseId": known, "fullName": name, "name": case.name}
    found |= {"status": _STATUS[case.result], "stage": "finished", "labels": list(_labels(case, suite))}
    details: dict[str, Any] = {} if case.result == "passed" else {"message": case.line, "trace": case.text}
    if case.finding is not None:
        rate = case.finding.finding.rate
        details |= {"known": True} if case.kind == "known" else {}
        details |= {"flaky": True} if rate and rate.count < rate.total else {}
        found["description"] = MarkdownReport().render(case.finding)
    elif case.told:
        found["description"] = "\n\n".join(map(code, as_text(case.told).splitlines()))
    if details:
        found["statusDetails"] = details
    return found | _times(view, case)


def _labels(case: ReportedCase, suite: str) -> Iterator[dict[str, str]]:
    labels = [("framework", "riot"), ("parentSuite", "riot"), ("suite", suite)]
    if case.finding is not None:
        finding = case.finding.finding
        labels += [("subSuite", finding.component), ("severity", _SEVERITY.get(finding.severity, ""))]
        labels += [("tag", finding.monitor), ("place", str(find_place(case.finding)))]
    if case.kind:
        labels.append(("kind", case.kind))
    yield from ({"name": name, "value": clean(value)} for name, value in labels if value)


def _times(view: CampaignView, case: ReportedCase) -> dict[str, int]:
    """Return when a case began and ended, in milliseconds; nothing if that is not known yet.

    A campaign ends as its record is written. A finding is explained after its record is written.
    """
    took = round(1000 * (case.seconds or 0.0))
    path = case.finding.directory / FindingRecord.FILE if case.finding else view.folder / CampaignRecord.FILE
    if (case.finding is None and view.campaign is None) or not path.is_file():
        return {}
    written = round(1000 * path.stat().st_mtime)
    start = written if case.finding else written - took
    return {"start": start, "stop": start + took}


def _attached(one: FindingView) -> Iterator[tuple[str, str | Path, str, str]]:
    """Yield what people open of a finding: ending, text or file, title, type; a page in its folder may be anybody's."""
    log = shortest_log(one.directory)
    if log.is_file() and log.stat().st_size <= _LARGEST:
        yield log.suffix, log, f"{'minimal' if log.stem == 'minimal' else 'failing'} log", "application/octet-stream"
    if (one.directory / PAGE).is_file():
        with suppress(MissingExtraError):
            yield ".html", HtmlReport().render(one), "report", "text/html"
