"""`riot scan`."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riot_bus.cli.ctl import Cfg, Endpoint
from riot_bus.cli.fastpath import warn
from riot_bus.cli.help_groups import ROBOTS
from riot_bus.cli.options import DEFAULT_OUT, Format, OutputFormat
from riot_bus.cli.printing import print_lines, print_result
from riot_bus.config.arguments import DEFAULT_ENDPOINT
from riot_bus_fleet.cli.options import CatalogueFile

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus_fleet.logs.entry import LogEntry
    from riot_bus_fleet.logs.near_misses import FleetScan


def register(app: typer.Typer) -> None:
    """Add this module's command."""
    app.command(rich_help_panel=ROBOTS)(scan)


def scan(
    places: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PLACE]...", help="Logs, folders, or URLs such as s3://b/logs. [default: those of the catalogue]"
        ),
    ] = None,
    *,
    rule: Annotated[
        Path,
        typer.Option(
            "--rule", "-r", help="Folder of a finding or its region, an output folder with one, or a rule.json."
        ),
    ] = DEFAULT_OUT,
    over: Annotated[
        str, typer.Option(metavar="QUERY", help="Which logs of the catalogue, as for riot fleet list; '' for all.")
    ] = "",
    catalogue: CatalogueFile = None,
    near: Annotated[int, typer.Option(min=1, max=1000, help="How many of each log's nearest moments to list.")] = 3,
    within: Annotated[
        float, typer.Option(min=0, help="Distance below which a moment is a near miss, in nominal spreads.")
    ] = 1.0,
    page: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a page with a picture of each log.")
    ] = None,
    watch: Annotated[
        bool, typer.Option("--watch", "-w", help="Look at live traffic instead, and warn before the rule is met.")
    ] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    cfg: Cfg = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Say how near logs came to meeting a finding's rule, by robot, nearest first; or watch what a router passes on.

    Results for logs of the catalogue are kept in it, and replace those of an earlier scan for the same rule.

    Exit code 1: the rule holds somewhere. 5: nothing could be judged.
    """
    from riot_bus.chain.base.workspace import open_finding
    from riot_bus.findings.records import RuleRecord
    from riot_bus.vocabulary.errors import InconclusiveError
    from riot_bus_fleet.cli.options import step_progress
    from riot_bus_fleet.scan import scan_logs

    source = rule if rule.is_file() or RuleRecord.exists(rule) else open_finding(rule)[0]
    if watch:
        given = {"PLACE": places, "--over": over, "--page": page, "--format": form is not OutputFormat.TEXT}
        _watch(source, endpoint, cfg or [], within, [name for name, value in given.items() if value])
        return
    logs = _logs(places or [], over, catalogue)
    with step_progress("scan") as progress:
        found = scan_logs(source, logs, near=near, within=within, progress=progress)
    if not places:
        _keep(found, catalogue)
    if page is not None:
        from riot_bus_fleet.page import write_fleet_page

        write_fleet_page(found, page)
    print_result(form, found.to_json(), found.lines())
    if len(found.unjudged) == len(found.logs):
        raise InconclusiveError("no log could be judged", where=str(rule), hint="each says why above")
    if found.failing:
        raise typer.Exit(1)


def _keep(found: FleetScan, catalogue: Path | None) -> None:
    """Write what was found into the catalogue, if that can be written."""
    from riot_bus.vocabulary.errors import EnvironmentFaultError
    from riot_bus_fleet.logs.catalogue import Catalogue, default_catalogue

    try:
        with Catalogue(catalogue or default_catalogue(), create=False) as known:
            known.put_scan(found)
    except EnvironmentFaultError as error:
        warn(f"warning: this scan is not in the catalogue: {error}")


def _watch(source: Path, endpoint: str, cfg: list[str], within: float, unfit: Sequence[str]) -> None:
    from riot_bus.control.component import client_cfg
    from riot_bus.vocabulary.errors import ConfigError, InconclusiveError
    from riot_bus_fleet.watch import watch_rule

    if unfit:
        raise ConfigError(f"{', '.join(unfit)} cannot be used with --watch", where="--watch", hint="they are for logs")

    found = watch_rule(source, endpoint, within=within, say=lambda line: print_lines([line]), config=client_cfg(cfg))
    print_lines([found.summary()])
    if not found.judged:
        raise InconclusiveError("nothing could be judged", where=endpoint, hint="are the types of its topics known?")
    if found.met:
        raise typer.Exit(1)


def _logs(places: Sequence[str], over: str, catalogue: Path | None) -> list[LogEntry]:
    """Return the catalogue entries of the named logs, or else of those in the catalogue."""
    from riot_bus.vocabulary.errors import ConfigError
    from riot_bus_fleet.logs.catalogue import Catalogue, default_catalogue
    from riot_bus_fleet.logs.index import index
    from riot_bus_fleet.logs.query import parse_query

    with closing(Catalogue(None if places else catalogue or default_catalogue(), create=bool(places))) as known:
        if places:
            report = index(known, places)
            if report.failures:
                raise ConfigError("\n  ".join(["could not be looked at:", *report.failures[:10]]))
        found = known.find(parse_query(over))
    if not found:
        raise ConfigError("no log matches", where="--over" if over else ", ".join(places) or str(catalogue))
    return found
