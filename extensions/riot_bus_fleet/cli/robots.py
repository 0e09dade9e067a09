"""`riot fleet robots|logs|play|record|status|pause|resume|seek|rate|stop`: robots on which `riot agent` runs."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from riot_bus.cli.ctl import Cfg
from riot_bus.cli.declared import declared, options_of
from riot_bus.cli.options import Format, OutputFormat
from riot_bus.cli.play import PlayCommand
from riot_bus.config.arguments import DEFAULT_ENDPOINT
from riot_bus.play.options import PlayOptions
from riot_bus.record.options import CaptureOptions
from riot_bus_fleet.agent.options import ControllerOptions

Robot = Annotated[str, typer.Argument(metavar="ROBOT", help="Name of the robot, as riot fleet robots lists it.")]
FleetEndpoint = Annotated[
    str,
    typer.Option("--endpoint", "-e", metavar="ENDPOINT", envvar="RIOT_FLEET", help="The fleet's router."),
]


def register(fleet: typer.Typer) -> None:
    """Add this module's commands."""
    for command in (robots, logs, play, record):
        fleet.command(cls=PlayCommand if command is play else None)(command)
    for name, help_text in _STEERING.items():
        fleet.command(name)(_steering(name, help_text))
        if name == "resume":
            fleet.command()(seek)
            fleet.command()(rate)


def robots(*, endpoint: FleetEndpoint = DEFAULT_ENDPOINT, cfg: Cfg = None, form: Format = OutputFormat.TEXT) -> None:
    """List the robots that are there, and what they are doing."""
    from dataclasses import asdict

    from riot_bus.control.component import client_cfg
    from riot_bus_fleet.agent.remote_operation import find_robots
    from riot_bus_fleet.agent.text import robot_lines

    found = find_robots(endpoint, config=client_cfg(cfg or ()))
    if form is OutputFormat.JSON:
        typer.echo(json.dumps({"robots": [asdict(each) for each in found]}, indent=1))
    else:
        typer.echo("\n".join(robot_lines(found)) if found else "no robot")


def logs(
    robot: Robot,
    query: Annotated[list[str] | None, typer.Argument(metavar="[QUERY]...", help="As for riot fleet list.")] = None,
    *,
    limit: Annotated[int, typer.Option(min=1, max=500, help="Most logs to list.")] = 100,
    offset: Annotated[int, typer.Option(min=0, help="Logs to skip at the beginning.")] = 0,
    endpoint: FleetEndpoint = DEFAULT_ENDPOINT,
    cfg: Cfg = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """List the logs that a robot holds, oldest first."""
    from riot_bus.control.component import client_cfg
    from riot_bus_fleet.agent.remote_operation import list_logs
    from riot_bus_fleet.agent.text import log_lines

    words = " ".join(query or [])
    answer = list_logs(endpoint, robot, config=client_cfg(cfg or ()), query=words, limit=limit, offset=offset)
    typer.echo(json.dumps(answer, indent=1) if form is OutputFormat.JSON else "\n".join(log_lines(answer)))


@declared(PlayOptions, before="on_lost_controller", remote=True)
@declared(ControllerOptions)
def play(
    robot: Robot,
    log: Annotated[list[str], typer.Argument(metavar="LOG...", help="Logs in the robot's folder of logs.")],
    *,
    inject: Annotated[
        Path | None, typer.Option(metavar="PLAN.toml", help="Injections; the plan is read here and sent along.")
    ] = None,
    form: Format = OutputFormat.TEXT,
    **given: Any,
) -> None:
    """Make a robot play logs that it holds into its own bus, and follow its progress; Ctrl-C stops it.

    When the robot loses this command (its machine is off, the link is broken), it stops after --grace seconds, unless
    --on-lost-controller says otherwise. With --detach it plays to the end, unwatched. Exit code 3: messages
    were lost. 4: no answer, busy, or stopped by another user.
    """
    own = {"logs": log, "inject": None if inject is None else _plan(inject)}
    _drive(robot, "play", own, given, form, policy="stop")


@declared(CaptureOptions, before="on_lost_controller", remote=True)
@declared(ControllerOptions)
def record(
    robot: Robot,
    keys: Annotated[
        list[str] | None, typer.Argument(metavar="[KEYEXPR]...", help="What to record. [default: everything]")
    ] = None,
    *,
    output: Annotated[
        str | None,
        typer.Option(
            "--output", "-o", metavar="FILE.mcap", help="File in the robot's folder of logs. [default: named by date]"
        ),
    ] = None,
    form: Format = OutputFormat.TEXT,
    **given: Any,
) -> None:
    """Make a robot record its own bus into its folder of logs, and follow its progress; Ctrl-C ends the recording.

    When the robot loses this command, it goes on recording, unless --on-lost-controller says otherwise. Exit code 3:
    messages were lost. 4: no answer, busy, or ended by another user.
    """
    _drive(robot, "record", {"keys": keys or ["**"], "output": output}, given, form, policy="continue")


_STEERING = {
    "status": "Show what a robot is doing, for whom, and how its last operation ended.",
    "pause": "Pause what a robot is doing.",
    "resume": "Make a robot go on after a pause.",
    "stop": "Stop what a robot is doing, also for another user.",
}
"""Commands that need only the robot's name, with their help."""


def _steering(command: str, help_text: str) -> Callable[..., None]:
    def run(
        robot: Robot, *, endpoint: FleetEndpoint = DEFAULT_ENDPOINT, cfg: Cfg = None, form: Format = OutputFormat.TEXT
    ) -> None:
        _steer(endpoint, cfg, robot, form, command)

    run.__doc__ = help_text
    return run


def seek(
    robot: Robot,
    time: Annotated[float, typer.Argument(metavar="SECONDS", help="Time since the beginning of the logs.")],
    *,
    endpoint: FleetEndpoint = DEFAULT_ENDPOINT,
    cfg: Cfg = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Make a robot go on playing from another time."""
    _steer(endpoint, cfg, robot, form, "seek", time=time)


def rate(
    robot: Robot,
    speed: Annotated[float, typer.Argument(metavar="RATE", help="1: as recorded; 0: as fast as possible.")],
    *,
    endpoint: FleetEndpoint = DEFAULT_ENDPOINT,
    cfg: Cfg = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Make a robot go on playing at another speed."""
    _steer(endpoint, cfg, robot, form, "rate", rate=speed)


def _plan(file: Path) -> str:
    from riot_bus.control.remote import plan_payload
    from riot_bus.vocabulary.errors import ConfigError

    try:
        return plan_payload(file)[0].decode()
    except UnicodeDecodeError as error:
        raise ConfigError(f"not a TOML file: {error}", where=str(file)) from None


def _drive(
    robot: str, kind: str, own: dict[str, Any], given: dict[str, Any], form: OutputFormat, *, policy: str
) -> None:
    from riot_bus.vocabulary.errors import INTERRUPTED
    from riot_bus_fleet.agent.controller import drive

    options = options_of(ControllerOptions, given)
    finished = drive(
        robot,
        kind,
        {**own, **given, **options.policy(policy)},
        options,
        say=typer.echo,
        show=_show if sys.stderr.isatty() else lambda _: None,
        as_json=form is OutputFormat.JSON,
    )
    if not finished:
        raise typer.Exit(INTERRUPTED)


def _show(line: str) -> None:
    typer.echo(f"\r\x1b[K{line[:100]}", err=True, nl=False)


def _steer(
    endpoint: str, cfg: list[str] | None, robot: str, form: OutputFormat, command: str, **arguments: Any
) -> None:
    from riot_bus.control.component import client_cfg
    from riot_bus_fleet.agent.remote_operation import ask_robot, who_am_i
    from riot_bus_fleet.agent.text import status_lines

    if command != "status":
        arguments["who"] = who_am_i()
    answer = ask_robot(endpoint, robot, command, config=client_cfg(cfg or ()), **arguments)
    typer.echo(json.dumps(answer, indent=1) if form is OutputFormat.JSON else "\n".join(status_lines(answer)))
