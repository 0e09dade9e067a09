"""`riot fleet`: the catalogue of a fleet's logs, and test cases over them; robots are in `fleet_robots`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riot_bus.cli.declared import declared
from riot_bus.cli.help_groups import ROBOTS
from riot_bus.cli.options import FindingsSystem, Format, OutputFormat, RunOptions, UnitName
from riot_bus_fleet.cli import robots as fleet_robots
from riot_bus_fleet.cli.options import CatalogueFile

if TYPE_CHECKING:
    from riot_bus_fleet.logs.catalogue import Catalogue

Words = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[QUERY]...",
        help="Conditions, such as robot=r7 topic=/odom type='nav_msgs/*' path='*/night/*' after=2026-11-01 "
        "before=7d min-duration=5m max-duration=1h min-messages=100 lossless damaged gone; all must hold.",
    ),
]


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    fleet = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="A fleet's logs and robots.")
    fleet.command()(index)
    fleet.command("list")(list_logs)
    fleet.command()(show)
    fleet.command()(run)
    fleet_robots.register(fleet)
    app.add_typer(fleet, name="fleet", rich_help_panel=ROBOTS)


def index(
    places: Annotated[
        list[str], typer.Argument(metavar="PLACE...", help="Folders, logs, or URLs such as s3://b/logs.")
    ],
    *,
    catalogue: CatalogueFile = None,
    robot: Annotated[
        str | None,
        typer.Option(help="Robot of the logs that do not name one. [default: name of the folder directly below PLACE]"),
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, help="Logs that are read at once.")] = 4,
    prune: Annotated[bool, typer.Option("--prune", help="Forget logs that are gone.")] = False,
    scan: Annotated[
        bool, typer.Option("--scan", help="Read all of each log, not only its summary: finds all damage.")
    ] = False,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Add logs to the catalogue; only new or changed ones are read. Run it again at any time, also after Ctrl-C.

    Exit code 4: something could not be read.
    """
    from dataclasses import asdict

    from rich.console import Console

    from riot_bus.cli.narrate import ConsoleNarrator
    from riot_bus.events import StepProgress, StepStarted
    from riot_bus.vocabulary.errors import EnvironmentFaultError
    from riot_bus_fleet.logs.index import index as bring_up_to_date
    from riot_bus_fleet.logs.text import index_line

    with ConsoleNarrator(Console(stderr=True)) as narrator, _open(catalogue, create=True) as known:
        narrator(StepStarted("index"))
        report = bring_up_to_date(
            known,
            places,
            robot=robot,
            jobs=jobs,
            prune=prune,
            scan=scan,
            progress=lambda done, place: narrator(StepProgress("index", done, None, place[-60:])),
        )
    typer.echo(json.dumps(asdict(report)) if form is OutputFormat.JSON else index_line(report))
    if report.failures:
        more = f"\n  and {len(report.failures) - 10} more" if len(report.failures) > 10 else ""
        raise EnvironmentFaultError("\n  ".join(["these could not be read:", *report.failures[:10]]) + more)


def list_logs(
    query: Words = None,
    *,
    catalogue: CatalogueFile = None,
    limit: Annotated[int, typer.Option(min=0, help="Maximum number of logs; 0: all.")] = 0,
    form: Format = OutputFormat.TEXT,
) -> None:
    """List logs, oldest first."""
    from riot_bus_fleet.logs.query import parse_query
    from riot_bus_fleet.logs.text import entry_json, list_lines

    with _open(catalogue) as known:
        found = known.find(parse_query(query or []), limit=limit or None)
    if form is OutputFormat.JSON:
        rows = [{name: value for name, value in entry_json(one).items() if name not in _DETAILS} for one in found]
        typer.echo(json.dumps({"logs": rows}, indent=1))
    else:
        typer.echo("\n".join(list_lines(found)) if found else "no log")


def show(
    log: Annotated[str, typer.Argument(help="Number in riot fleet list, path, URL, or the end of a path or URL.")],
    *,
    catalogue: CatalogueFile = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Say all that the catalogue knows of one log: topics, types, counts, metadata of the run, what is wrong."""
    from riot_bus_fleet.logs.text import entry_json, show_lines

    with _open(catalogue) as known:
        found = known.show(log)
    typer.echo(json.dumps(entry_json(found), indent=1) if form is OutputFormat.JSON else "\n".join(show_lines(found)))


@declared(RunOptions, "out", "seed", "jobs")
def run(
    testcase: Annotated[
        Path, typer.Argument(help="An injection plan, the folder of a finding, its fields.json, or its failing log.")
    ],
    *,
    over: Annotated[str, typer.Option(metavar="QUERY", help="Which logs, as for riot fleet list; '' for all.")],
    catalogue: CatalogueFile = None,
    system: FindingsSystem = None,
    unit: UnitName = None,
    times: Annotated[int, typer.Option(min=1, help="Fresh trials of each log.")] = 1,
    start_offset: Annotated[
        float, typer.Option(metavar="SECONDS", min=0, help="Leave out this much at the beginning of each log.")
    ] = 0.0,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", min=0, help="Play this much of each log.")
    ] = None,
    anywhere: Annotated[
        bool,
        typer.Option(
            "--anywhere", help="Inject into all messages of a topic, whatever numbers or times TESTCASE names."
        ),
    ] = False,
    again: Annotated[bool, typer.Option("--again", help="Try all logs again, also those with an answer.")] = False,
    form: Format = OutputFormat.TEXT,
    **given: Any,
) -> None:
    """Replay a test case against the current software, with each matching log as its nominal input.

    The answer for a log is fixed, failed or error. The first two are kept in the output folder, so that the same
    command goes on where it stopped. Exit code 0: all are fixed. 1: at least one still fails. 4: at least one error.
    """
    from dataclasses import asdict

    from rich.console import Console

    from riot_bus.chain.base.systems import system_of
    from riot_bus.chain.base.workspace import Workspace
    from riot_bus.cli.narrate import ConsoleNarrator
    from riot_bus.vocabulary.errors import ConfigError
    from riot_bus_fleet.logs.query import parse_query
    from riot_bus_fleet.logs.text import answer_lines
    from riot_bus_fleet.over_fleet import FleetOptions, exit_code, run_over
    from riot_bus_fleet.testcases import load_case_template

    template = load_case_template(testcase)
    with _open(catalogue) as known:
        logs = known.find(parse_query(over))
    if not logs:
        raise ConfigError("no log matches", where="--over", hint=f"try: riot fleet list {over}")
    file, how = system_of(template.system, testcase, named=system), RunOptions(**given)
    with (
        ConsoleNarrator(Console(stderr=True)) as narrator,
        Workspace(file, how.out, jobs=how.jobs, seed=how.seed, listeners=[narrator], fresh=True) as workspace,
    ):
        name = workspace.context.file.choose_unit(unit or template.unit)
        options = FleetOptions(times=times, start=start_offset, duration=duration, again=again)
        answers = run_over(workspace, template.anywhere() if anywhere else template, name, logs, options)
    rows = [asdict(each) for each in answers]
    typer.echo(json.dumps({"logs": rows}, indent=1) if form is OutputFormat.JSON else "\n".join(answer_lines(rows)))
    if exit_code(answers):
        raise typer.Exit(exit_code(answers))


_DETAILS = ("topics", "metadata")


def _open(path: Path | None, *, create: bool = False) -> Catalogue:
    from riot_bus_fleet.logs.catalogue import Catalogue, default_catalogue

    return Catalogue(path or default_catalogue(), create=create)
