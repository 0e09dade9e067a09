"""`riot report`, `findings`."""

from __future__ import annotations

import json
from pathlib import Path

import typer

from riot_bus.cli.options import Finding, Format, OutputFormat

__all__ = ["register"]

DEFAULT_OUT = Path("riot-out")


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    for command in (report, findings):
        app.command()(command)


def report(finding: Finding = DEFAULT_OUT) -> None:
    """Write one self-contained HTML page about a finding."""
    from riot_bus.chain.workspace import open_finding
    from riot_bus.report.page import write_report

    folder, _ = open_finding(finding)
    typer.echo(str(write_report(folder)))


def findings(finding: Finding = DEFAULT_OUT, *, form: Format = OutputFormat.TEXT) -> None:
    """List the findings of an output folder, each in a few lines."""
    from riot_bus.findings.records import FindingRecord
    from riot_bus.report.text import summary

    folders = sorted(path.parent for path in (finding / "findings").glob(f"*/{FindingRecord.FILE}"))
    if form is OutputFormat.JSON:
        records = [{"folder": str(one), **FindingRecord.load(one).model_dump(mode="json")} for one in folders]
        typer.echo(json.dumps(records, indent=1))
    else:
        typer.echo("\n\n".join(summary(one) for one in folders) or "no finding")
