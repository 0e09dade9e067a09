"""`riot backchain`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from riot_bus.cli.declared import declared
from riot_bus.cli.help_groups import EXPLAIN
from riot_bus.cli.options import FindingsSystem, RunOptions
from riot_bus.cli.printing import print_json, print_lines


class _Form(StrEnum):
    TEXT = "text"
    JSON = "json"
    DOT = "dot"


def register(app: typer.Typer) -> None:
    """Add this module's command."""
    app.command(rich_help_panel=EXPLAIN)(backchain)


@declared(RunOptions, "seed")
def backchain(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Nominal logs (.mcap), or folders of bags.")],
    *,
    to: Annotated[
        str, typer.Option("--to", metavar="FIELD|FINDING", help="Internal field (TOPIC:FIELD), or folder of a finding.")
    ],
    system: FindingsSystem = None,
    external: Annotated[
        list[str] | None,
        typer.Option("--external", metavar="TOPIC", help="Topic that is controlled from outside; repeatable."),
    ] = None,
    delay: Annotated[
        float, typer.Option("--delay", min=0.001, help="Longest delay to look for in one step of a path, in seconds.")
    ] = 2.0,
    picture: Annotated[Path | None, typer.Option("--picture", metavar="FILE", help="Picture to draw (.svg).")] = None,
    form: Annotated[
        _Form, typer.Option("--format", envvar="RIOT_FORMAT", help="Form of the result on stdout.")
    ] = _Form.TEXT,
    **given: Any,
) -> None:
    """Find which external fields an internal field follows, and along which paths, from nominal logs alone.

    Nothing is run. Exit code 5: these logs tell nothing about the field.
    """
    from riot_bus.vocabulary.errors import InconclusiveError
    from riot_bus_fleet.cli.options import step_progress
    from riot_bus_fleet.evidence.backchain import backchain as find_way
    from riot_bus_fleet.evidence.picture import check_picture, dot, write_picture
    from riot_bus_fleet.evidence.text import lines

    if picture is not None:
        check_picture(picture)
    with step_progress("backchain") as progress:
        record = find_way(
            logs,
            to,
            system=system,
            externals=external or (),
            horizon=delay,
            progress=progress,
            seed=given["seed"],
        )
    if picture is not None:
        write_picture(record, picture)
    if form is _Form.JSON:
        print_json(record.model_dump(mode="json"))
    elif form is _Form.DOT:
        typer.echo(dot(record), nl=False)
    else:
        print_lines(lines(record))
    if all(record.targets.values()):
        raise typer.Exit(InconclusiveError.exit_code)
