"""`riot cluster check`."""

from __future__ import annotations

from typing import Annotated

import typer

from riot_bus.cli.help_groups import ROBOTS
from riot_bus.cli.options import DEFAULT_SYSTEM, Format, OutputFormat, System
from riot_bus.cli.printing import print_result


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    cluster = typer.Typer(no_args_is_help=True)
    cluster.callback()(lambda: None)
    cluster.command()(check)
    app.add_typer(cluster, name="cluster", rich_help_panel=ROBOTS, help="Workers of a Dask cluster, for --executor.")


def check(
    executor: Annotated[
        str, typer.Argument(envvar="RIOT_EXECUTOR", metavar="dask://HOST:PORT", help="Scheduler of the cluster.")
    ],
    *,
    system: System = DEFAULT_SYSTEM,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Check that the workers of a cluster would take trials of a system. Exit code 4: none or not all would."""
    from dataclasses import asdict

    from riot_bus.trial.context import open_system
    from riot_bus.vocabulary.counting import counted
    from riot_bus.vocabulary.errors import EnvironmentFaultError
    from riot_bus_cluster.workers import check_cluster

    found = check_cluster(executor, open_system(system))
    ready = sum(not each.refused for each in found)
    lines = [
        f"{each.address} {each.host}".rstrip() + f": {each.refused or 'same versions, same code'}" for each in found
    ]
    lines.append(f"{counted(ready, 'worker')} of {len(found)} would take trials")
    print_result(form, [asdict(each) for each in found], lines)
    if not found or ready < len(found):
        raise typer.Exit(EnvironmentFaultError.exit_code)
