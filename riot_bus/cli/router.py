"""`riot router`: a drop-in Zenoh router that intercepts what flows between its segments."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["router"]


def router(
    segment: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=ENDPOINT[,ENDPOINT...]",
            help="A segment and where it listens; repeatable. "
            "[default: system=tcp/127.0.0.1:7447 and unit=tcp/127.0.0.1:7448]",
        ),
    ] = None,
    intercept: Annotated[
        list[str] | None,
        typer.Option(metavar="KEYEXPR", help="What goes through the interceptors; ROS names such as /odom will do."),
    ] = None,
    interceptor: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE.py[:NAME]", help="An interceptor class; repeatable, carried out in this order."),
    ] = None,
    inject: Annotated[
        Path | None, typer.Option(metavar="PLAN.toml", help="Injections; their topics are intercepted.")
    ] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="OUT.mcap", help="Record all that passes, intercepted or not.")
    ] = None,
    type_: Annotated[
        list[str] | None, typer.Option("--type", metavar="TOPIC=TYPE", help="Type of a topic's messages.")
    ] = None,
    msg: Annotated[list[Path] | None, typer.Option(metavar="FILE.msg", help="Definition of a message type.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of everything that is random.")] = 0,
) -> None:
    """Route messages between segments and intercept some of them, until Ctrl-C.

    Components connect to their segment's endpoint as to any Zenoh router; nothing else changes for them. When it ends,
    it prints what happened to each topic. Exit code 3: messages were lost. 4: an endpoint is in use.
    """
    from riot_bus.bus.serve import DEFAULT_SEGMENTS, RouterOptions, run_router

    options = RouterOptions(
        segments=segment or DEFAULT_SEGMENTS,
        intercept=intercept or (),
        interceptors=interceptor or (),
        inject=inject,
        record=record,
        types=type_ or (),
        definitions=msg or (),
        seed=seed,
    )
    run_router(options, say=typer.echo, warn=lambda line: typer.echo(line, err=True))
