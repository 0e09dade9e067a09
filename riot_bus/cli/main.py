"""The command `riot`: turns options into calls, outcomes into exit codes, and errors into one clear message."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from riot_bus import __version__
from riot_bus.cli import (
    agent,
    archives,
    bridge,
    chain,
    ctl,
    doctor,
    edit,
    fleet,
    graph,
    init,
    logs,
    play,
    record,
    reports,
    router,
)
from riot_bus.errors import RiotError

__all__ = ["app", "run"]

INTERRUPTED = 130

app = typer.Typer(
    name="riot",
    help="Robustness Inside-Out Testing: find a fault deep inside one unit, explain it, and drive the outside until "
    "the whole system fails.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    add_completion=True,
)


def _version(value: bool) -> None:  # noqa: FBT001 - called by typer
    if value:
        typer.echo(f"riot_bus {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Robustness Inside-Out Testing on a message bus."""


for _module in (
    chain,
    reports,
    logs,
    archives,
    play,
    edit,
    record,
    router,
    ctl,
    graph,
    init,
    doctor,
    fleet,
    agent,
    bridge,
):
    _module.register(app)


def run() -> None:
    """Entry point of the console scripts."""
    try:
        app(standalone_mode=True)
    except RiotError as error:
        typer.echo(f"riot: {error}", err=True)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        typer.echo("riot: interrupted; run the same command again to go on", err=True)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
