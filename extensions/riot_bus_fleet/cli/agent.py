"""`riot agent`; `riot agent acl`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from riot_bus.cli.declared import declared
from riot_bus.cli.help_groups import ROBOTS
from riot_bus.cli.options import Format, OutputFormat
from riot_bus_fleet.agent.options import AgentOptions


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    group = typer.Typer(rich_markup_mode=None)
    group.callback(invoke_without_command=True)(agent)
    group.command("acl")(acl)
    app.add_typer(group, name="agent", rich_help_panel=ROBOTS)


@declared(AgentOptions)
def agent(context: typer.Context, *, form: Format = OutputFormat.TEXT, **given: Any) -> None:
    """Play and record logs on this robot by remote command: see `riot fleet play`.

    Runs until it is told to end. If the link to the fleet's router breaks, it connects again.
    """
    from riot_bus.cli.terminal import foreground_of
    from riot_bus.vocabulary.errors import ConfigError
    from riot_bus_fleet.agent.service import run_agent

    if context.invoked_subcommand is not None:
        return
    if "folder" not in given:
        raise ConfigError("no folder of logs is named", where="--logs", hint="riot agent --logs FOLDER")
    run_agent(AgentOptions(**given), foreground_of(form))


def acl(
    roles: Annotated[
        list[str],
        typer.Argument(
            metavar="ROLE[=USER]...",
            help="agent, controller or viewer, and the user with this role; by default named like it.",
        ),
    ],
    *,
    robot: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Robot that the rules are about; *: all, also for agents, which need it."),
    ] = None,
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

    from riot_bus.vocabulary.errors import ConfigError
    from riot_bus.vocabulary.toml_text import toml_value
    from riot_bus_fleet.agent.access import access_rules, parse_subject, question_limits
    from riot_bus_fleet.agent.names import check_robot

    subjects = [parse_subject(each) for each in roles]
    if robot is None and any(role == "agent" for role, _ in subjects):
        hint = "--robot NAME; with --robot '*', the user of one agent may answer for every robot"
        raise ConfigError("which robot's agent is this?", where="--robot", hint=hint)
    if robot not in (None, "*"):
        check_robot(robot)
    rules = access_rules(subjects, robot=robot or "*", certificates=certificates)
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
