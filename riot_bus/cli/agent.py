"""`riot agent`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riot_bus.cli.ctl import DEFAULT_ENDPOINT
from riot_bus.cli.options import Format, OutputFormat

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command()(agent)


def agent(
    *,
    logs: Annotated[
        Path,
        typer.Option(
            "--logs", metavar="FOLDER", envvar="RIOT_AGENT_LOGS", help="Nothing outside of it is read or written."
        ),
    ],
    robot: Annotated[
        str | None, typer.Option(metavar="NAME", envvar="RIOT_ROBOT", help="Its name. [default: this machine's]")
    ] = None,
    endpoint: Annotated[
        str,
        typer.Option("--endpoint", "-e", metavar="ENDPOINT", envvar="RIOT_ENDPOINT", help="Router of the robot's bus."),
    ] = DEFAULT_ENDPOINT,
    fleet: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT",
            envvar="RIOT_FLEET",
            help="Router that gives commands. [default: that of the robot's bus]",
        ),
    ] = None,
    cfg: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="A Zenoh setting of clients of the robot's bus; repeatable."),
    ] = None,
    fleet_cfg: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE", help="Of the client of the fleet's router, such as a certificate; repeatable."
        ),
    ] = None,
    allow: Annotated[
        list[str] | None,
        typer.Option(metavar="play|record|nothing", help="What it may do; repeatable. [default: play and record]"),
    ] = None,
    catalogue: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            envvar="RIOT_AGENT_CATALOGUE",
            help="Where to keep what it knows of its logs, so that they are not read again at each start.",
        ),
    ] = None,
    keep_free: Annotated[
        str, typer.Option(metavar="SIZE", help="So much of the disk is left free by recordings.")
    ] = "512MiB",
    form: Format = OutputFormat.TEXT,
) -> None:
    """Play and record logs on this robot, as commands from afar say: see `riot fleet play`.

    Runs until it is told to end. The link to the fleet's router may break at any time: it is made again.
    """
    from riot_bus.agent.names import default_robot
    from riot_bus.agent.options import PERMISSIONS, AgentOptions
    from riot_bus.agent.running import run_agent
    from riot_bus.config.arguments import parse_size
    from riot_bus.control.component import client_cfg

    options = AgentOptions(
        robot=default_robot() if robot is None else robot,
        folder=logs,
        endpoint=endpoint,
        fleet=fleet,
        config=client_cfg(cfg or ()),
        fleet_config=client_cfg(fleet_cfg or ()),
        allow=() if allow == ["nothing"] else allow or PERMISSIONS,
        catalogue=catalogue,
        keep_free=parse_size(keep_free, "--keep-free"),
    )
    run_agent(
        options,
        say=typer.echo,
        tell=lambda line: typer.echo(line, err=True),
        as_json=form is OutputFormat.JSON,
    )
