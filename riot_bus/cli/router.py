"""`riot router`: a drop-in Zenoh router that intercepts what flows between its segments; `riot router env`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from riot_bus.cli.fastpath import start_router
from riot_bus.cli.options import Format, OutputFormat

__all__ = ["ComponentCfg", "Host", "register"]

Segments = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=ENDPOINT[,ENDPOINT...]",
        envvar="RIOT_SEGMENT",
        help="A segment and where it listens; repeatable. "
        "[default: system=tcp/127.0.0.1:7447 and unit=tcp/127.0.0.1:7448]",
    ),
]
SystemFile = Annotated[
    Path | None,
    typer.Option(
        "--system", "-s", metavar="FILE", envvar="RIOT_SYSTEM", help="System file. [default: riot.toml, if it exists]"
    ),
]


Host = Annotated[str | None, typer.Option(help="The router's machine, for components on another one.")]
ComponentCfg = Annotated[
    list[str] | None,
    typer.Option(metavar="KEY=VALUE", help="A Zenoh setting of the component; KEY=@FILE for passwords; repeatable."),
]


class FlavourName(StrEnum):
    """The kind of program that reads an environment."""

    RMW_ZENOH = "rmw_zenoh"
    ZENOH = "zenoh"


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    group = typer.Typer(rich_markup_mode=None)
    group.callback(invoke_without_command=True)(router)
    group.command("env")(env)
    app.add_typer(group, name="router")


def router(
    context: typer.Context,
    *,
    system: SystemFile = None,
    segment: Segments = None,
    connect: Annotated[
        list[str] | None,
        typer.Option(metavar="SEGMENT=ENDPOINT[,...]", envvar="RIOT_CONNECT", help="A router that a segment joins."),
    ] = None,
    cfg: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SEGMENT:KEY=VALUE",
            envvar="RIOT_CFG",
            help="A Zenoh setting of a segment; KEY=@FILE for secrets; repeatable.",
        ),
    ] = None,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", envvar="RIOT_NAME", help="The router's name. [default: router]")
    ] = None,
    intercept: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEYEXPR",
            envvar="RIOT_INTERCEPT",
            help="What goes through the interceptors; ROS names such as /odom will do.",
        ),
    ] = None,
    intercept_services: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEYEXPR",
            envvar="RIOT_INTERCEPT_SERVICES",
            help="Services and actions whose requests and replies go through the interceptors; repeatable.",
        ),
    ] = None,
    interceptor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="'NAME key=value ...'|FILE.py[:NAME]",
            help="A shipped interceptor (riot interceptors), or your own class; repeatable, carried out in this order.",
        ),
    ] = None,
    inject: Annotated[
        Path | None,
        typer.Option(metavar="PLAN.toml", envvar="RIOT_INJECT", help="Injections; their topics are intercepted."),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="OUT.mcap", envvar="RIOT_RECORD", help="Record all that passes, intercepted or not."),
    ] = None,
    type_: Annotated[
        list[str] | None, typer.Option("--type", metavar="TOPIC=TYPE", help="Type of a topic's messages.")
    ] = None,
    msg: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Definitions of message types.")] = None,
    seed: Annotated[int, typer.Option(envvar="RIOT_SEED", help="Seed of everything that is random.")] = 0,
    budget: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", envvar="RIOT_BUDGET", help="How long an interceptor may block. [default: 1]"),
    ] = None,
    control: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SEGMENT",
            envvar="RIOT_CONTROL",
            help="A segment from which riot ctl may be used; repeatable. [default: those that only this host reaches]",
        ),
    ] = None,
    bypass_watch: Annotated[
        bool, typer.Option("--bypass-watch/--no-bypass-watch", help="Look for ways around the router.")
    ] = True,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Route messages between segments and intercept some of them, until Ctrl-C.

    Components connect to their segment's endpoint as to any Zenoh router; nothing else changes for them. When it ends,
    it prints what happened to each topic. Exit code 3: messages were lost. 4: an endpoint is in use.
    """
    if context.invoked_subcommand is not None:
        return
    start_router(
        system=system,
        segment=segment,
        connect=connect,
        cfg=cfg,
        name=name,
        intercept=intercept,
        intercept_services=intercept_services,
        interceptor=interceptor,
        inject=inject,
        record=record,
        type_=type_,
        msg=msg,
        seed=seed,
        budget=budget,
        control=control,
        bypass_watch=bypass_watch,
        as_json=form is OutputFormat.JSON,
    )


def env(
    segment_name: Annotated[str, typer.Argument(metavar="SEGMENT", help="The segment that the component is to use.")],
    *,
    flavour: Annotated[
        FlavourName, typer.Option(help="For ROS 2 nodes, or for programs that use Zenoh directly.")
    ] = FlavourName.RMW_ZENOH,
    host: Host = None,
    cfg: ComponentCfg = None,
    file: Annotated[
        Path | None, typer.Option(help="For zenoh: the file to write. [default: zenoh-SEGMENT.json5]")
    ] = None,
    system: SystemFile = None,
    segment: Segments = None,
) -> None:
    """Print what makes a component use a segment, for eval "$(...)"."""
    from riot_bus.control.component import component_environment

    lines, hints = component_environment(
        segment_name, flavour.value, system=system, segments=segment or (), host=host, cfg=cfg or (), file=file
    )
    for hint in hints:
        typer.echo(f"hint: {hint}", err=True)
    typer.echo("\n".join(lines))
