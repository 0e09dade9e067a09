"""`riot cluster check`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from riot_bus.cli.options import Format, OutputFormat, System

__all__ = ["register"]

ENVIRONMENT = 4  # exit code for problems of the environment, listed in docs/chain.md


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    cluster = typer.Typer(no_args_is_help=True)
    cluster.callback()(lambda: None)
    cluster.command()(check)
    app.add_typer(cluster, name="cluster", help="Workers of a Dask cluster, for --executor.")


def check(
    executor: Annotated[
        str, typer.Argument(envvar="RIOT_EXECUTOR", metavar="dask://HOST:PORT", help="Scheduler of the cluster.")
    ],
    *,
    system: System = Path("riot.toml"),
    form: Format = OutputFormat.TEXT,
) -> None:
    """Check that the workers of a cluster would take trials of a system. Exit code 4: none or not all would."""
    from dataclasses import asdict

    from riot_bus.cluster.workers import check_cluster
    from riot_bus.sut.context import open_system
    from riot_bus.vocabulary.counting import counted

    found = check_cluster(executor, open_system(system))
    if form is OutputFormat.JSON:
        typer.echo(json.dumps([asdict(each) for each in found], indent=1))
    else:
        for each in found:
            typer.echo(f"{each.address} {each.host}".rstrip() + f": {each.refused or 'same versions, same code'}")
        ready = sum(not each.refused for each in found)
        typer.echo(f"{counted(ready, 'worker')} of {len(found)} would take trials")
    if not found or any(each.refused for each in found):
        raise typer.Exit(ENVIRONMENT)
