"""A campaign as SARIF 2.1.0, which GitHub, GitLab, Azure DevOps and editors show beside the code.

Results of several runs are matched by rule and fingerprint, the finding's signature, since lines of code may shift.
"""

from __future__ import annotations

import json
from typing import Any
from urllib.parse import quote

import riot_bus
from riot_bus.findings.known import fingerprint_of
from riot_bus.findings.records import FindingRecord, ProportionRecord
from riot_bus.report.campaign_view import CampaignView, level_of
from riot_bus.report.finding_view import FindingView
from riot_bus.report.format import clean
from riot_bus.report.location import find_place

_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
_ROOT = "%SRCROOT%"
_LONGEST = 900
_MOST = 5000
"""Largest number of results; GitHub shows no more of one upload."""


class SarifReport:
    """The report format `sarif`."""

    file = "riot.sarif"

    def render_campaign(self, view: CampaignView) -> str:
        """Return the log; findings of other code than what was tested are left out, as they were not seen again."""
        findings = view.current[:_MOST]
        rules = list(dict.fromkeys(_rule_id(one.finding) for one in findings))
        told = {_rule_id(one.finding): f"{one.failure} (monitor `{_rule_id(one.finding)}`)" for one in findings}
        run = {
            "tool": {
                "driver": {
                    "name": "riot_bus",
                    "version": riot_bus.__version__,
                    "semanticVersion": riot_bus.__version__,
                    "rules": [_rule(name, told[name]) for name in rules],
                }
            },
            "automationDetails": {"id": f"riot_bus/{clean(view.unit, limit=100)}/"},
            "invocations": [
                {
                    "executionSuccessful": view.finished and not view.problem,
                    "toolExecutionNotifications": [
                        {"level": level, "message": _message(text)} for level, text in _notes(view)
                    ],
                }
            ],
            "originalUriBaseIds": {_ROOT: {"description": {"text": "The root of the repository."}}},
            "results": [_result(one, rules) | _standing(view, one) for one in findings],
        }
        log = {"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}
        return json.dumps(log, indent=1) + "\n"


def _rule_id(finding: FindingRecord) -> str:
    return clean(finding.monitor, limit=100) or "failure"


def _rule(name: str, told: str) -> dict[str, Any]:
    text = f"A component {told}."
    return {
        "id": name,
        "name": name,
        "shortDescription": _message(text),
        "fullDescription": _message(f"{text} The failure has come again in fresh trials."),
        "help": _message(
            f"{text} `riot reproduce FINDING` shows it again, `riot report FINDING` all that is known of it."
        ),
        "properties": {"tags": ["robustness"]},
    }


def _result(one: FindingView, rules: list[str]) -> dict[str, Any]:
    finding, digest = one.finding, fingerprint_of(one.finding)
    place = find_place(one)
    file = {"uri": quote(place.path), "uriBaseId": _ROOT}
    detail = f" {finding.details[0]}" if finding.details else ""
    properties: dict[str, Any] = {key: clean(text, limit=_LONGEST) for key, text in one.facts().items()}
    properties |= {"rate": _rate(finding.rate), "nominal": _rate(finding.nominal)}
    return {
        "ruleId": _rule_id(finding),
        "ruleIndex": rules.index(_rule_id(finding)),
        "level": level_of(finding),
        "message": _message(f"{one.verdict_text}{detail}"),
        "locations": [{"physicalLocation": {"artifactLocation": file, "region": {"startLine": place.line}}}],
        # GitHub matches results by the second only, else by a hash of the line, which several findings may share.
        "partialFingerprints": {"riotSignature/v1": digest, "primaryLocationLineHash": f"{digest[:16]}:1"},
        "properties": properties,
    }


def _standing(view: CampaignView, one: FindingView) -> dict[str, Any]:
    """Return the status of a finding in the baseline; empty if there is no baseline."""
    standing = view.standing(one)
    if standing != "known":
        return {"baselineState": "new"} if standing else {}
    suppression = {"kind": "external", "status": "accepted", "justification": clean(view.told(one), limit=_LONGEST)}
    return {"baselineState": "unchanged", "suppressions": [suppression]}


def _rate(rate: ProportionRecord | None) -> dict[str, Any] | None:
    return rate.model_dump(mode="json") if rate else None


def _notes(view: CampaignView) -> list[tuple[str, str]]:
    found = [("warning" if view.excused else "error", view.problem)] if view.problem else []
    found += [("note", remark) for remark in view.remarks]
    found += [("note" if view.finished and not view.doubts else "warning", view.verdict)]
    left = len(view.current) - _MOST
    found += [("warning", f"{left} more findings are left out")] if left > 0 else []
    return [*found, *(("warning", doubt) for doubt in view.doubts[:_MOST])]


def _message(text: str) -> dict[str, str]:
    """Return a message of plain text: braces and links in it would have a meaning."""
    return {"text": clean(text, limit=_LONGEST).replace("{", "{{").replace("}", "}}").replace("](", "] (")}
