"""`riot report`, `findings`, `trials`, `compare`, `predict`, `guard`."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from riot_bus.cli.fastpath import warn
from riot_bus.cli.options import DEFAULT_OUT, Finding, Format, OutputFormat
from riot_bus.cli.printing import print_json, print_lines, print_result


class _Action(StrEnum):
    DROP = "drop"
    CLAMP = "clamp"
    HOLD = "hold"
    REPORT = "report"


def report(
    finding: Annotated[
        Path,
        typer.Argument(help="Folder of a finding, or an output folder; html, text and json take just one finding."),
    ] = DEFAULT_OUT,
    *,
    form: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="NAME",
            help="html, text, json: of one finding; junit, sarif, markdown, github: of a campaign, too; or a "
            "format of another package.",
        ),
    ] = "html",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="File to write. [default: by the format, a file in the folder or stdout]",
        ),
    ] = None,
    baseline: Annotated[
        Path | None,
        typer.Option(
            "--baseline",
            "-b",
            metavar="FILE",
            help="File that lists the known findings, as for riot ci; only for formats of a campaign.",
        ),
    ] = None,
) -> None:
    """Report a finding as one self-contained HTML page, or in another format; some report a whole campaign."""
    from riot_bus.chain.base.workspace import open_finding
    from riot_bus.plugins import REPORTS
    from riot_bus.report.campaign_view import is_output_folder
    from riot_bus.report.formats import CampaignFormat, append_summary, beside_baseline, render, view_of, write_file

    made = REPORTS.load(form, where="--format")()
    every = isinstance(made, CampaignFormat) and is_output_folder(finding)
    folder = finding if every else open_finding(finding)[0]
    view = view_of(folder)
    if baseline is not None:
        view = beside_baseline(made, view, baseline)
    content = render(made, view)
    if out is None and not made.file:
        typer.echo(content, nl=False)
    else:
        typer.echo(str(write_file(content, out or folder / made.file)))
    append_summary(made, view)


def findings(
    finding: Annotated[Path, typer.Argument(help="Output folder of a campaign.")] = DEFAULT_OUT,
    *,
    form: Format = OutputFormat.TEXT,
) -> None:
    """List the findings of an output folder, each in a few lines, and the result of its campaign."""
    from riot_bus.report.campaign_view import is_output_folder, load_campaign
    from riot_bus.report.text import TextReport
    from riot_bus.vocabulary.counting import counted
    from riot_bus.vocabulary.errors import ConfigError
    from riot_bus.vocabulary.redaction import escape_control_chars

    if not is_output_folder(finding):
        hint = "name the --out folder of a campaign; one that has found nothing yet writes nothing here before it ends"
        raise ConfigError("there are neither findings nor an ended campaign here", where=str(finding), hint=hint)
    view = load_campaign(finding)
    if form is OutputFormat.JSON:
        print_json([{"folder": str(one.directory), **one.finding.model_dump(mode="json")} for one in view.findings])
    else:
        for one in view.findings:
            typer.echo(TextReport().render(one))
        campaign, told = view.campaign, [view.verdict]
        if campaign:
            told += campaign.doubts
            told += [
                f"not confirmed: {one.signature} ({one.hits} of {counted(one.repeats, 'fresh trial')})"
                for one in campaign.unconfirmed
            ]
            told += [*(f"not told: {each}" for each in campaign.untold), *campaign.effects.lines()]
        print_lines(told)
    for name, why in view.broken.items():
        warn(escape_control_chars(f"{name} cannot be used: {why}"))


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
    from riot_bus.log.tables.parquet_rows import write_rows

    write_rows(out, rows)
    typer.echo(str(out))


def compare(
    old: Annotated[Path, typer.Argument(help="Output folder of the older campaign.")],
    new: Annotated[Path, typer.Argument(help="Output folder of the newer campaign.")],
    *,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Compare two campaigns: failures that are new, still occur, or were not seen. Exit 1 if there are new ones."""
    from riot_bus.findings.comparison import compare as compared

    found = compared(old, new)
    print_result(form, found.to_json(), found.lines())
    if any(each.change == "new" for each in found.findings):
        raise typer.Exit(1)


def predict(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log (.mcap) of any length.")],
    finding: Finding = DEFAULT_OUT,
    *,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Say where a unit would fail in a log, by a finding's rule. Exit 1 if it would, 5 if that is not known."""
    from riot_bus.chain.base.workspace import open_finding
    from riot_bus.chain.unit.prediction import predict_log
    from riot_bus.vocabulary.errors import InconclusiveError

    found = predict_log(log, open_finding(finding)[0])
    print_result(form, found.to_json(), found.lines())
    if found.would_fail is None:
        raise typer.Exit(InconclusiveError.exit_code)
    if found.would_fail:
        raise typer.Exit(1)


def guard(
    finding: Finding = DEFAULT_OUT,
    *,
    action: Annotated[
        _Action, typer.Option("--action", "-a", help="What is done with a message that meets the rule.")
    ] = _Action.DROP,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Print the lines for riot.toml that put a guard in front of a unit, and what it does to the finding's logs."""
    from dataclasses import asdict

    from riot_bus.chain.base.workspace import open_finding
    from riot_bus.chain.steps.guard import plan_guard

    plan = plan_guard(open_finding(finding)[0], action=action.value)
    if form is OutputFormat.JSON:
        print_json(asdict(plan))
        return
    print_lines(f"# {line}" for line in plan.lines())
    typer.echo(plan.toml)
