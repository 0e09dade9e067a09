"""`riot ctl play`: look at a running player and steer it."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Annotated

import typer

from riot_bus.cli.options import Format, OutputFormat
from riot_bus.cli.printing import print_result

PlayerName = Annotated[
    str | None,
    typer.Option("--player", metavar="NAME", envvar="RIOT_PLAYER", help="The player's name, if several answer."),
]


_PLAIN = {
    "status": "Show where the player is, and how late its messages are.",
    "pause": "Pause playing.",
    "resume": "Go on playing after a pause.",
    "stop": "Stop playing.",
}
"""Commands without arguments of their own, and their help."""


def group() -> typer.Typer:
    """Return the commands."""
    found = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Control a running player.")
    for name, text in _PLAIN.items():
        found.command(name, help=text)(_plain(name))
    for each in (step, seek, rate):
        found.command()(each)
    return found


def _plain(name: str) -> Callable[..., None]:
    def command(context: typer.Context, *, player: PlayerName = None, form: Format = OutputFormat.TEXT) -> None:
        _tell(context, player, form, name)

    return command


def step(
    context: typer.Context,
    count: Annotated[int, typer.Argument(min=1, help="Number of messages.")] = 1,
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


def _tell(context: typer.Context, player: str | None, form: OutputFormat, command: str, **arguments: float) -> None:
    from riot_bus.control.component import client_cfg
    from riot_bus.control.remote import ask
    from riot_bus.play.text import status_lines

    endpoint, _, cfg = context.obj
    payload = json.dumps(arguments).encode()
    found = ask(endpoint, player, f"play/{command}", payload, config=client_cfg(cfg), kind="player")
    print_result(form, found, status_lines(found))
