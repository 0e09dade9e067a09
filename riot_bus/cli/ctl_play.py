"""`riot ctl play`: look at a running player and steer it."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from riot_bus.cli.options import Format, OutputFormat

__all__ = ["group"]

PlayerName = Annotated[
    str | None,
    typer.Option("--player", metavar="NAME", envvar="RIOT_PLAYER", help="The player's name, if several answer."),
]


def group() -> typer.Typer:
    """Return the commands."""
    found = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Control a running player.")
    for each in (status, pause, resume, step, seek, rate, stop):
        found.command()(each)
    return found


def status(context: typer.Context, *, player: PlayerName = None, form: Format = OutputFormat.TEXT) -> None:
    """Show where the player is, and how late its messages are."""
    _tell(context, player, form, "status")


def pause(context: typer.Context, *, player: PlayerName = None, form: Format = OutputFormat.TEXT) -> None:
    """Pause playing."""
    _tell(context, player, form, "pause")


def resume(context: typer.Context, *, player: PlayerName = None, form: Format = OutputFormat.TEXT) -> None:
    """Go on playing after a pause."""
    _tell(context, player, form, "resume")


def step(
    context: typer.Context,
    count: Annotated[int, typer.Argument(min=1, help="How many messages.")] = 1,
    *,
    player: PlayerName = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Publish the next messages at once, then pause."""
    _tell(context, player, form, "step", count=count)


def seek(
    context: typer.Context,
    time: Annotated[float, typer.Argument(metavar="SECONDS", help="Time since the beginning of the logs.")],
    *,
    player: PlayerName = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Go on playing from another time."""
    _tell(context, player, form, "seek", time=time)


def rate(
    context: typer.Context,
    speed: Annotated[float, typer.Argument(metavar="RATE", help="1: as recorded; 0: as fast as possible.")],
    *,
    player: PlayerName = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Go on playing at another speed."""
    _tell(context, player, form, "rate", rate=speed)


def stop(context: typer.Context, *, player: PlayerName = None, form: Format = OutputFormat.TEXT) -> None:
    """Stop playing."""
    _tell(context, player, form, "stop")


def _tell(context: typer.Context, player: str | None, form: OutputFormat, command: str, **arguments: float) -> None:
    from riot_bus.control.component import client_cfg
    from riot_bus.control.remote import ask
    from riot_bus.play.text import status_lines

    endpoint, _, cfg = context.obj
    payload = json.dumps(arguments).encode()
    found = ask(endpoint, player, f"play/{command}", payload, config=client_cfg(cfg), kind="player")
    typer.echo(json.dumps(found, indent=1) if form is OutputFormat.JSON else "\n".join(status_lines(found)))
