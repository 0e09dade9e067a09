"""`riot play`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from riot_bus.cli.ctl import DEFAULT_ENDPOINT, Cfg, Endpoint
from riot_bus.cli.diff import end_with, print_difference
from riot_bus.cli.options import Format, OutputFormat, Salvage, Tolerance, ToleranceFile

__all__ = ["register"]

INTERRUPTED = 130  # exit code that shells report for a process ended by SIGINT: 128 + 2
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
    start_offset: Annotated[float, typer.Option(metavar="SECONDS", help="Leave out this much at the beginning.")] = 0.0,
    duration: Annotated[float | None, typer.Option(metavar="SECONDS", help="Play this much of the logs' time.")] = None,
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
        typer.Option(metavar="[HZ]", help="Publish /clock for ROS 2's simulated time; without HZ, 40 times a second."),
    ] = 0.0,
    wait: Annotated[
        float, typer.Option(metavar="SECONDS", help="Wait at most this long until all topics have subscribers.")
    ] = 2.0,
    lockstep: Annotated[
        list[str] | None,
        typer.Option(metavar="KEYEXPR", help="Wait after each message until this key is quiet (--quiet); repeatable."),
    ] = None,
    ack: Annotated[
        str | None, typer.Option(metavar="KEYEXPR", help="Wait after each message until one comes on this key.")
    ] = None,
    quiet: Annotated[
        float, typer.Option(metavar="SECONDS", help="Time without a message that counts as quiet, for --lockstep.")
    ] = 0.05,
    settle_timeout: Annotated[
        float, typer.Option(metavar="SECONDS", help="Longest wait after a message, for --lockstep and --ack.")
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
    expect: Annotated[
        Path | None, typer.Option(metavar="LOG", help="Record the system's answers, and compare them with this log.")
    ] = None,
    expect_topics: Annotated[
        list[str] | None,
        typer.Option(metavar="TOPIC", help="Compare these. [default: all of the --expect log that are not played]"),
    ] = None,
    expect_wait: Annotated[
        float, typer.Option(metavar="SECONDS", min=0, help="Wait at most this long for answers when all is played.")
    ] = 10.0,
    answers: Annotated[
        Path | None, typer.Option(metavar="FILE", help="With --expect: keep the answers in this file.")
    ] = None,
    tolerance: Tolerance = None,
    tolerances: ToleranceFile = None,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="With --expect: also write the result as an HTML page.")
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
    1: the answers are not as expected. 3: messages could not be read or published. 4: no router answers. 130:
    interrupted.
    """
    from riot_bus.cli.terminal import Terminal
    from riot_bus.control.component import client_cfg
    from riot_bus.play.options import PlayOptions
    from riot_bus.play.running import run_play
    from riot_bus.vocabulary.errors import ConfigError

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
    how: dict[str, Any] = {
        "say": typer.echo,
        "warn": lambda line: typer.echo(line, err=True),
        "console": Terminal() if Terminal.present() else None,
        "as_json": form is OutputFormat.JSON,
    }
    if expect is None:
        given: dict[str, object] = {"--expect-topics": expect_topics, "--answers": answers, "--html": html}
        given |= {"--tolerance": tolerance, "--tolerances": tolerances}
        unfit = [option for option, value in given.items() if value]
        if unfit:
            raise ConfigError(
                f"{', '.join(unfit)} cannot be used without --expect", hint="name the log to compare with"
            )
        if not run_play(options, **how):
            raise typer.Exit(INTERRUPTED)
        return
    from riot_bus.log.comparison.compare import Wishes
    from riot_bus.log.comparison.tolerances import tolerances_of
    from riot_bus.sut.expectation import Expectation, play_expecting

    wishes = Wishes(tolerances=tolerances_of(tolerance or (), tolerances or ()))
    wanted = Expectation(log=expect, topics=expect_topics or (), wishes=wishes, wait=expect_wait, answers=answers)
    found = play_expecting(options, wanted, **how)
    if found is None:
        raise typer.Exit(INTERRUPTED)
    print_difference(found, html, form, event="compared")
    end_with(found)
