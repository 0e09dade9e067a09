"""`riot report`, `findings`, `trials`, `compare`, `predict`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from riot_bus.cli.options import Finding, Format, OutputFormat

__all__ = ["register"]

DEFAULT_OUT = Path("riot-out")


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    for command in (report, findings, trials, compare, predict):
        app.command()(command)


def report(
    finding: Finding = DEFAULT_OUT,
    *,
    form: Annotated[
        str, typer.Option("--format", metavar="NAME", help="html, text, json, or a format of another package.")
    ] = "html",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="Where to write it. [default: report.html in the finding's folder; text and json: stdout]",
        ),
    ] = None,
) -> None:
    """Report a finding, as one self-contained HTML page unless asked otherwise."""
    from riot_bus.chain.workspace import open_finding
    from riot_bus.plugins import REPORTS
    from riot_bus.report.finding_view import load
    from riot_bus.report.formats import write_file

    made = REPORTS.load(form, where="--format")()
    folder, _ = open_finding(finding)
    content = made.render(load(folder))
    if out is None and not made.file:
        typer.echo(content, nl=False)
    else:
        typer.echo(str(write_file(content, out or folder / made.file)))


def findings(finding: Finding = DEFAULT_OUT, *, form: Format = OutputFormat.TEXT) -> None:
    """List the findings of an output folder, each in a few lines."""
    from riot_bus.findings.records import CampaignRecord, FindingRecord
    from riot_bus.report.text import summary
    from riot_bus.vocabulary.redaction import escape_control_chars

    paths = sorted((finding / "findings").glob(f"*/{FindingRecord.FILE}"))
    folders = sorted((path.parent for path in paths), key=lambda folder: FindingRecord.load(folder).rank)
    if form is OutputFormat.JSON:
        records = [{"folder": str(one), **FindingRecord.load(one).model_dump(mode="json")} for one in folders]
        typer.echo(json.dumps(records, indent=1))
    else:
        typer.echo("\n\n".join(summary(one) for one in folders) or "no finding")
        if CampaignRecord.exists(finding):
            record = CampaignRecord.load(finding)
            for line in (*map(str, record.unjudged), *record.effects.lines()):
                typer.echo(escape_control_chars(line))


def trials(
    folder: Annotated[Path, typer.Argument(metavar="[OUT]", help="Output folder of a campaign.")] = DEFAULT_OUT,
    *,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write a Parquet file instead of JSON lines.")
    ] = None,
) -> None:
    """List all trials of an output folder, also while a campaign runs: verdict, signatures, seconds."""
    from riot_bus.campaign.store import TrialStore, stored_trials
    from riot_bus.vocabulary.errors import ConfigError

    path = folder / "trials" / TrialStore.NAME
    if not path.is_file():
        raise ConfigError("no trials are kept here", where=str(path), hint="name the --out folder of a campaign")
    rows = stored_trials(path)
    if out is None:
        for row in rows:
            typer.echo(json.dumps(row))
        return
    from riot_bus.log.tables.export_parquet import write_rows

    write_rows(out, rows)
    typer.echo(str(out))


def compare(
    old: Annotated[Path, typer.Argument(help="Output folder of the older campaign.")],
    new: Annotated[Path, typer.Argument(help="Of the newer one.")],
    *,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Compare two campaigns: failures that are new, still come, or were not seen. Exit 1 if there are new ones."""
    from riot_bus.findings.comparison import compare as compared
    from riot_bus.vocabulary.redaction import escape_control_chars

    found = compared(old, new)
    if form is OutputFormat.JSON:
        typer.echo(json.dumps(found.to_json(), indent=1))
    else:
        for line in found.lines():
            typer.echo(escape_control_chars(line))
    if any(each.change == "new" for each in found.findings):
        raise typer.Exit(1)


def predict(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log (.mcap) of any length.")],
    finding: Finding = DEFAULT_OUT,
    *,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Say where a unit would fail in a log, by a finding's rule. Exit 1 if it would, 5 if the rule cannot be judged."""
    from riot_bus.chain.prediction import predict_log
    from riot_bus.chain.workspace import open_finding
    from riot_bus.vocabulary.redaction import escape_control_chars

    found = predict_log(log, open_finding(finding)[0])
    if form is OutputFormat.JSON:
        typer.echo(json.dumps(found.to_json(), indent=1))
    else:
        for line in found.lines():
            typer.echo(escape_control_chars(line))
    if found.fails:
        raise typer.Exit(1)
