"""`riot play`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from riot_bus.cli.ctl import DEFAULT_ENDPOINT, Cfg, Endpoint
from riot_bus.cli.options import Format, OutputFormat, Salvage

__all__ = ["register"]

INTERRUPTED = 130
_CLOCK_HZ = "40"


class _Play(TyperCommand):
    """Takes `--clock` without a number, as `ros2 bag play` does."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        words = list(args)
        for place, word in enumerate(args):
            following = args[place + 1 : place + 2]
            if word == "--clock" and not (following and following[0].replace(".", "", 1).isdecimal()):
                words[place] = f"--clock={_CLOCK_HZ}"
        return super().parse_args(ctx, words)


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command(cls=_Play)(play)


def play(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="MCAP files, or folders of them; merged by time.")
    ],
    *,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    cfg: Cfg = None,
    rate: Annotated[float, typer.Option("--rate", "-r", help="Speed; 0 is as fast as possible.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", "-l", help="Begin again at the end.")] = False,
    delay: Annotated[float, typer.Option("--delay", "-d", metavar="SECONDS", help="Wait before each pass.")] = 0.0,
    start_offset: Annotated[float, typer.Option(metavar="SECONDS", help="Leave out so much at the beginning.")] = 0.0,
    duration: Annotated[float | None, typer.Option(metavar="SECONDS", help="Play so much of the logs' time.")] = None,
    until: Annotated[
        str | None, typer.Option(metavar="TIME", help="End there: seconds from the beginning, or a date and time.")
    ] = None,
    align: Annotated[bool, typer.Option("--align", help="Let all logs begin at the same time.")] = False,
    topics: Annotated[
        list[str] | None, typer.Option(metavar="TOPIC", help="Play these: names or key expressions; repeatable.")
    ] = None,
    exclude: Annotated[
        list[str] | None, typer.Option(metavar="TOPIC", help="Leave these out: likewise; repeatable.")
    ] = None,
    remap: Annotated[
        list[str] | None,
        typer.Option("--remap", "-m", metavar="OLD:=NEW", help="Rename a topic, or all below it: '/a/**:=/b/**'."),
    ] = None,
    start_paused: Annotated[bool, typer.Option("--start-paused", "-p", help="Begin paused.")] = False,
    hold: Annotated[bool, typer.Option("--hold", help="Stay at the end, for late joiners of latched topics.")] = False,
    clock: Annotated[
        float,
        typer.Option(metavar="[HZ]", help="Publish /clock for ROS 2's simulated time, 40 times a second if not said."),
    ] = 0.0,
    wait: Annotated[
        float, typer.Option(metavar="SECONDS", help="Wait at most so long until all topics have subscribers.")
    ] = 2.0,
    lockstep: Annotated[
        list[str] | None,
        typer.Option(metavar="KEYEXPR", help="Wait after each message until these are quiet; repeatable."),
    ] = None,
    ack: Annotated[
        str | None, typer.Option(metavar="KEYEXPR", help="Wait after each message until something comes there.")
    ] = None,
    quiet: Annotated[float, typer.Option(metavar="SECONDS", help="So long is quiet, for --lockstep.")] = 0.05,
    settle_timeout: Annotated[
        float, typer.Option(metavar="SECONDS", help="After so long go on all the same, for --lockstep and --ack.")
    ] = 5.0,
    inject: Annotated[
        Path | None, typer.Option(metavar="PLAN.toml", envvar="RIOT_INJECT", help="Injections into what is played.")
    ] = None,
    interceptor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="'NAME key=value ...'|FILE.py[:NAME]",
            help="A shipped interceptor, or your own class; repeatable, carried out in this order.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(envvar="RIOT_SEED", help="Seed of everything that is random.")] = 0,
    domain: Annotated[
        int | None,
        typer.Option(help="ROS domain to publish in. [default: as recorded; for bags ROS_DOMAIN_ID, else 0]"),
    ] = None,
    latched: Annotated[
        list[str] | None,
        typer.Option(metavar="TOPIC[=DEPTH]", help="Keep the last messages for late joiners, whatever was recorded."),
    ] = None,
    salvage: Salvage = False,
    type_: Annotated[
        list[str] | None, typer.Option("--type", metavar="TOPIC=TYPE", help="Type of a topic's messages.")
    ] = None,
    msg: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Definitions of message types.")] = None,
    name: Annotated[str, typer.Option(envvar="RIOT_PLAYER", help="Name for riot ctl play.")] = "player",
    control: Annotated[bool, typer.Option("--control/--no-control", help="Obey riot ctl play.")] = True,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Play logs to the components of a Zenoh router, with the recorded timing and quality of service.

    ROS 2 bags (MCAP) become topics of rmw_zenoh. On a terminal, keys pause, step, seek and change the speed. Exit code
    3: messages could not be read or published. 4: no router answers. 130: interrupted.
    """
    from riot_bus.cli.terminal import Terminal
    from riot_bus.control.component import client_cfg
    from riot_bus.play.options import PlayOptions
    from riot_bus.play.running import run_play

    options = PlayOptions(
        logs=logs,
        endpoint=endpoint,
        config=client_cfg(cfg or ()),
        name=name,
        rate=rate,
        loop=loop,
        delay=delay,
        start_offset=start_offset,
        duration=duration,
        until=until,
        align=align,
        topics=topics or (),
        exclude=exclude or (),
        remap=remap or (),
        paused=start_paused,
        hold=hold,
        clock=clock,
        wait=wait,
        lockstep=lockstep or (),
        ack=ack,
        quiet=quiet,
        settle_timeout=settle_timeout,
        inject=inject,
        interceptors=interceptor or (),
        salvage=salvage,
        types=type_ or (),
        definitions=msg or (),
        seed=seed,
        domain=domain,
        latched=latched or (),
        control=control,
    )
    finished = run_play(
        options,
        say=typer.echo,
        warn=lambda line: typer.echo(line, err=True),
        console=Terminal() if Terminal.present() else None,
        as_json=form is OutputFormat.JSON,
    )
    if not finished:
        raise typer.Exit(INTERRUPTED)
