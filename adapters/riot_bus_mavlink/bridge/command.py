"""`riot bridge mavlink`: its options; imports nothing heavy until it is run."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from riot_bus.types.bridging import OwnRouter
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from riot_bus.types.bridging import BridgeHost

__all__ = ["mavlink"]

Names = list[str] | None


def mavlink(
    context: typer.Context,
    program: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[-- PROGRAM [ARG]...]",
            help="Program run behind the bridge, as one component with it; {port}: port of the first listening link.",
            show_default=False,
        ),
    ] = None,
    *,
    link: Annotated[
        list[str] | None,
        typer.Option(
            "--link",
            "-l",
            metavar="[SEGMENT[/NAME]=]URL",
            help="A link: udpin:0.0.0.0:14550, udpout:HOST:PORT, tcpin:0.0.0.0:5760, tcp:HOST:PORT, "
            "/dev/ttyACM0,115200, or a .tlog file; repeatable.",
        ),
    ] = None,
    segment: Annotated[
        list[str] | None,
        typer.Option(
            "--segment",
            metavar="NAME[=ENDPOINT]",
            help="Segment to join: its name in riot.toml (else system or unit), or NAME=ENDPOINT; repeatable.",
        ),
    ] = None,
    system: Path | None = None,
    endpoint: Annotated[
        str | None,
        typer.Option("--endpoint", "-e", metavar="ENDPOINT", help="Where the segment listens, if there is only one."),
    ] = None,
    cfg: Names = None,
    listen: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=ENDPOINT[,...]",
            help="Own router (without --segment and --endpoint): a segment and where it listens; repeatable. "
            "[default: as of riot router]",
        ),
    ] = None,
    intercept: Annotated[
        list[str] | None,
        typer.Option(metavar="KEYEXPR", help="Own router: what goes through interceptors, such as COMMAND_LONG."),
    ] = None,
    interceptor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="'NAME key=value ...'|FILE.py[:NAME]",
            help="Own router: interceptor of what --intercept names, as for riot router; repeatable.",
        ),
    ] = None,
    inject: Annotated[
        Path | None,
        typer.Option(metavar="PLAN.toml", help="Own router: injections; their topics are intercepted."),
    ] = None,
    record: Annotated[Path | None, typer.Option(metavar="OUT.mcap", help="Own router: record all that passes.")] = None,
    dialect: Annotated[
        str | None, typer.Option(metavar="NAME", help="MAVLink dialect, of those that pymavlink ships. [default: all]")
    ] = None,
    definitions: Annotated[
        list[Path] | None,
        typer.Option("--xml", metavar="FILE", help="XML file that defines more messages; repeatable."),
    ] = None,
    keys: Annotated[
        str | None,
        typer.Option(
            metavar="TEMPLATE", help="Template of the keys on the bus. [default: mavlink_raw/{link}/{sysid}/...]"
        ),
    ] = None,
    duplicates: Annotated[
        float,
        typer.Option(
            metavar="SECONDS", help="Drop a frame that came within this time before, over any link; 0: drop none."
        ),
    ] = 0.0,
    key_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="File with the key to re-sign signed frames that come late or are renumbered."
        ),
    ] = None,
    sniffer: Annotated[int, typer.Option(metavar="SYSID", help="System that gets all frames; 0: none.")] = 0,
    mirror: Annotated[
        Literal["messages", "fields"] | None,
        typer.Option(help="Also publish frames as JSON on mavlink/..., and take such, as mavlink-server does."),
    ] = None,
    form: str = "text",
) -> None:
    """Route MAVLink between links and segments, until Ctrl-C.

    Links of one segment see each other directly, those of different segments through riot, where their messages can be
    intercepted. With a segment for the autopilot and one for the ground station, riot is between them:

    riot bridge mavlink --inject plan.toml --link system=/dev/ttyACM0,115200 --link unit=tcpin:0.0.0.0:5760

    The bridge is then its own router, which is the fastest way; riot ctl works with it, too. With --segment NAME or
    --endpoint ENDPOINT, the bridge joins segments of a running riot router instead.
    """
    from contextlib import ExitStack

    from riot_bus_mavlink.bridge.bridge import MavlinkBridge
    from riot_bus_mavlink.bridge.options import MavlinkBridgeOptions
    from riot_bus_mavlink.dialect import DEFAULT
    from riot_bus_mavlink.keys import TEMPLATE

    joins = segment is not None or endpoint is not None
    wanted = {"listen": listen, "intercept": intercept, "interceptor": interceptor, "inject": inject, "record": record}
    source = context.get_parameter_source("cfg")  # an environment variable may be meant for other commands
    written = cfg if source is not None and source.name == "COMMANDLINE" else None
    _check_ways(segment, endpoint, written, joins=joins, of_router=[name for name, value in wanted.items() if value])
    options = MavlinkBridgeOptions(
        links=link or (),
        dialect=dialect or DEFAULT,
        files=definitions or (),
        keys=keys or TEMPLATE,
        duplicates=duplicates,
        sniffer=sniffer,
        key_file=key_file,
        mirror=mirror,
        patient=bool(program),
    )
    host: BridgeHost = context.obj
    warn, as_json = partial(typer.echo, err=True), form == "json"
    if joins:
        places = host.ports(_places(segment or [f"={endpoint}"]), system=system, cfg=cfg or ())
        options.plan(list(places))
        with ExitStack() as stack:
            ports = {name: stack.enter_context(port) for name, port in places.items()}
            bridge = MavlinkBridge(ports, options, warn=warn)
            status = host.run(bridge, program=program or (), as_json=as_json)
    else:
        asked = OwnRouter(
            system,
            segments=listen or (),
            intercept=intercept or (),
            interceptors=interceptor or (),
            inject=inject,
            record=record,
            definitions=definitions or (),
            adapters=options.adapters(),
        )
        plan = options.plan(list(host.segments(asked)))
        status = host.run_router(
            lambda ports: MavlinkBridge(ports, options, warn=warn),
            replace(asked, carried=[plan.keys.expression()]),
            program=program or (),
            as_json=as_json,
        )
    if status:
        raise typer.Exit(status)


def _check_ways(
    segment: list[str] | None, endpoint: str | None, cfg: list[str] | None, *, joins: bool, of_router: list[str]
) -> None:
    where = "riot bridge mavlink"
    if segment is not None and endpoint is not None:
        raise ConfigError("which segment?", where=where, hint="give --segment NAME or --endpoint ENDPOINT, not both")
    if joins and of_router:
        text = f"--{of_router[0]} is for a bridge that is its own router; this one joins another"
        hint = f"give it to riot router, or leave {'--segment' if segment else '--endpoint'} out"
        raise ConfigError(text, where=where, hint=hint)
    if not joins and cfg:
        raise ConfigError("--cfg is for a router elsewhere", where=where, hint="write it into [router] of riot.toml")


def _places(texts: list[str]) -> dict[str, str | None]:
    """Return the endpoints of segments by name, None for those given by name only."""
    places: dict[str, str | None] = {}
    for text in texts:
        name, equals, endpoint = text.partition("=")
        if name in places:
            raise ConfigError(f"segment {name!r} is named twice", where="--segment")
        places[name] = endpoint if equals else None
    return places
