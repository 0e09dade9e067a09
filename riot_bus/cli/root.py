"""Options of `riot` itself, before a command."""

from __future__ import annotations

from typing import Annotated

import typer

from riot_bus import __version__


def _version(value: bool) -> None:  # noqa: FBT001 - called by typer
    if value:
        typer.echo(f"riot_bus {__version__}")
        raise typer.Exit


def options(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Robustness Inside-Out Testing on a message bus."""
