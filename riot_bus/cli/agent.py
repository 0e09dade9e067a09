"""`riot agent`; `riot agent acl`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riot_bus.cli.options import Format, OutputFormat
from riot_bus.config.arguments import DEFAULT_ENDPOINT

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    group = typer.Typer(rich_markup_mode=None)
    group.callback(invoke_without_command=True)(agent)
    group.command("acl")(acl)
    app.add_typer(group, name="agent")


def agent(
    context: typer.Context,
    *,
    logs: Annotated[
        Path | None,
        typer.Option(
            "--logs",
            metavar="FOLDER",
            envvar="RIOT_AGENT_LOGS",
            help="Folder of the robot's logs; no others are read or written.",
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(metavar="NAME", envvar="RIOT_ROBOT", help="Name of this robot. [default: this machine's name]"),
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
            help="The fleet's router, through which commands come. [default: that of the robot's bus]",
        ),
    ] = None,
    cfg: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            envvar="RIOT_CLIENT_CFG",
            help="A Zenoh setting for connections to the robot's bus; KEY=@FILE for passwords; repeatable.",
        ),
    ] = None,
    fleet_cfg: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            envvar="RIOT_FLEET_CFG",
            help="A Zenoh setting for the connection to the fleet's router; KEY=@FILE for passwords; repeatable.",
        ),
    ] = None,
    allow: Annotated[
        list[str] | None,
        typer.Option(
            metavar="play|record|nothing", help="What this agent may do; repeatable. [default: play and record]"
        ),
    ] = None,
    catalogue: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            envvar="RIOT_AGENT_CATALOGUE",
            help="File to keep what is known of the logs, so that they are not read again at each start.",
        ),
    ] = None,
    keep_free: Annotated[str, typer.Option(metavar="SIZE", help="Disk space that recordings leave free.")] = "512MiB",
    form: Format = OutputFormat.TEXT,
) -> None:
    """Play and record logs on this robot by remote command: see `riot fleet play`.

    Runs until it is told to end. If the link to the fleet's router breaks, it connects again.
    """
    from riot_bus.agent.names import default_robot
    from riot_bus.agent.options import PERMISSIONS, AgentOptions
    from riot_bus.agent.running import run_agent
    from riot_bus.config.arguments import parse_size
    from riot_bus.control.component import client_cfg
    from riot_bus.vocabulary.errors import ConfigError

    if context.invoked_subcommand is not None:
        return
    if logs is None:
        raise ConfigError("no folder of logs is named", where="--logs", hint="riot agent --logs FOLDER")
    options = AgentOptions(
        robot=default_robot() if robot is None else robot,
        folder=logs,
        endpoint=endpoint,
        fleet=fleet,
        config=client_cfg(cfg or ()),
        fleet_config=client_cfg(fleet_cfg or (), where="--fleet-cfg"),
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


def acl(
    roles: Annotated[
        list[str],
        typer.Argument(
            metavar="ROLE[=USER]...",
            help="agent, controller or viewer, and the user with this role; by default named like it.",
        ),
    ],
    *,
    robot: Annotated[str, typer.Option(metavar="NAME", help="Robot that the rules are about; *: all.")] = "*",
    segment: Annotated[
        str, typer.Option(metavar="NAME", help="Segment of the fleet's router, as its riot.toml names it.")
    ] = "fleet",
    certificates: Annotated[
        bool, typer.Option("--certificates", help="Users are common names of certificates (mutual TLS).")
    ] = False,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Print Zenoh's access control rules for a fleet's router: each role may do what it needs, all else is denied.

    --format text is for the riot.toml of `riot router`, --format json for the configuration file of any Zenoh router.
    """
    import json

    from riot_bus.agent.access import access_rules, parse_subject, question_limits
    from riot_bus.agent.names import check_robot
    from riot_bus.vocabulary.toml_text import toml_value

    if robot != "*":
        check_robot(robot)
    rules = access_rules(map(parse_subject, roles), robot=robot, certificates=certificates)
    if form is OutputFormat.JSON:
        typer.echo(json.dumps({"access_control": rules, "downsampling": question_limits()}, indent=1))
        return
    table = f"router.segments.{segment}.config"
    for limit in question_limits():
        typer.echo(f"[[{table}.downsampling]]")
        for name, value in limit.items():
            typer.echo(f"{name} = {toml_value(value)}")
    typer.echo(f"\n[{table}.access_control]")
    for name, value in rules.items():
        rows = isinstance(value, list)
        text = "[\n" + "".join(f"    {toml_value(each)},\n" for each in value) + "]" if rows else toml_value(value)
        typer.echo(f"{name} = {text}")
