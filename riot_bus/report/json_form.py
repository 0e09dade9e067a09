"""One finding as JSON, for programs: all records in one document."""

from __future__ import annotations

import json

from riot_bus.report.finding_view import FindingView


class JsonReport:
    """The report format `json`; its keys are described in docs/findings.md."""

    file = ""

    def render(self, view: FindingView) -> str:
        """Return the records by step, null for missing ones, with severity, verdict and next step."""
        document = {
            "version": 1,
            "folder": str(view.directory),
            "severity": view.severity,
            "verdict": view.verdict_text,
            "next": view.next_step,
            "steps": {step.name: record and record.model_dump(mode="python") for step, record in view.steps},
            "unusable": dict(view.broken),
        }
        return json.dumps(document, indent=1, default=str) + "\n"
