"""`riot bridge`: joins other middleware to a segment."""

from __future__ import annotations

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riot_bus.cli.ctl import Cfg
from riot_bus.cli.options import Format, OutputFormat
from riot_bus.cli.router import SystemFile

if TYPE_CHECKING:
    from riot_bus.bridge.program import Program
    from riot_bus_mavlink.bridge.bridge import MavlinkBridge

__all__ = ["register"]

Names = list[str] | None


class MirrorMode(StrEnum):
    """What of a frame is published as JSON."""

    MESSAGES = "messages"
    FIELDS = "fields"


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    bridge = typer.Typer(help="Join other middleware to a segment.", no_args_is_help=True, rich_markup_mode=None)
    bridge.command()(ros2)
    bridge.command()(mavlink)
    app.add_typer(bridge, name="bridge")


def ros2(
    *,
    domain: Annotated[
        int, typer.Option("--domain", "-d", envvar="ROS_DOMAIN_ID", help="ROS_DOMAIN_ID of the nodes.")
    ] = 0,
    segment: Annotated[
        str | None,
        typer.Option("--segment", metavar="NAME", help="Segment of riot.toml, or of a router without one."),
    ] = None,
    system: SystemFile = None,
    endpoint: Annotated[
        str | None, typer.Option("--endpoint", "-e", metavar="ENDPOINT", help="Where it listens, instead of its name.")
    ] = None,
    cfg: Cfg = None,
    topics: Annotated[
        Names,
        typer.Option(
            metavar="NAME",
            help="Bridge only these, such as '/camera/**'; repeatable. [default: all that are not hidden]",
        ),
    ] = None,
    services: Annotated[
        Names,
        typer.Option(metavar="NAME", help="Likewise. [default: all but those that every node has; actions, too]"),
    ] = None,
    exclude: Annotated[Names, typer.Option(metavar="NAME", help="Leave these out; repeatable.")] = None,
    zenoh_domain: Annotated[
        int, typer.Option(help="ROS_DOMAIN_ID that stands in the keys; bridges that shall meet have the same.")
    ] = 0,
    depth: Annotated[int, typer.Option(help="Messages that the bridge keeps for slow peers, by topic.")] = 1000,
    latched: Annotated[int, typer.Option(help="Messages that it keeps for late joiners of latched topics.")] = 100,
    python: Annotated[
        str | None,
        typer.Option(metavar="PYTHON", envvar="RIOT_ROS_PYTHON", help="Has rclpy. [default: the first on PATH]"),
    ] = None,
    setup: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", envvar="RIOT_ROS_SETUP", help="Is sourced before, such as /opt/ros/jazzy/setup.bash."
        ),
    ] = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Join a ROS 2 domain, whatever its middleware, to a segment: topics, services and actions; until Ctrl-C.

    Two bridges with different domains at two segments of `riot router` put it between the nodes of these domains. ROS
    needs nothing but its own rclpy; on the segment, its nodes look like those of rmw_zenoh.
    """
    from riot_bus.bridge.port import open_port
    from riot_bus.bridge.running import run_bridge
    from riot_bus.control.component import client_cfg, segment_endpoints
    from riot_bus.vocabulary.errors import ConfigError
    from riot_bus_ros2.bridge.bridge import Ros2Bridge
    from riot_bus_ros2.bridge.options import Ros2BridgeOptions

    if (segment is None) == (endpoint is None):
        raise ConfigError("which segment?", where="riot bridge ros2", hint="give --segment NAME or --endpoint ENDPOINT")
    options = Ros2BridgeOptions(
        domain=domain,
        zenoh_domain=zenoh_domain,
        topics=topics,
        services=services,
        exclude=exclude or (),
        depth=depth,
        latched=latched,
        python=python,
        setup=setup,
    )
    options.check()
    config = client_cfg(cfg or ())
    if segment is not None:
        endpoints, config = segment_endpoints(segment, config, system=system)
    else:
        endpoints = [endpoint or ""]
    with open_port(endpoints, config=config) as port:
        bridge = Ros2Bridge(port, options, warn=lambda line: typer.echo(line, err=True))
        run_bridge(bridge, say=typer.echo, as_json=form is OutputFormat.JSON)


def mavlink(
    program: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[-- PROGRAM [ARG]...]",
            help="Is run behind the bridge, ends with it, and is a component with it; {port} is where the first link "
            "listens.",
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
            help="Such as udpin:0.0.0.0:14550, udpout:HOST:PORT, tcpin:0.0.0.0:5760, tcp:HOST:PORT, "
            "/dev/ttyACM0,115200, or a .tlog file; repeatable.",
        ),
    ] = None,
    segment: Annotated[
        list[str] | None,
        typer.Option(
            "--segment",
            metavar="NAME[=ENDPOINT]",
            help="Segment of riot.toml, or of a router without one, or where it listens; repeatable.",
        ),
    ] = None,
    system: SystemFile = None,
    endpoint: Annotated[
        str | None, typer.Option("--endpoint", "-e", metavar="ENDPOINT", help="Where the only segment listens.")
    ] = None,
    cfg: Cfg = None,
    listen: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=ENDPOINT[,...]",
            help="Without --segment and --endpoint, the bridge is its own router: a segment of it, and where that "
            "listens; repeatable. [default: as of riot router]",
        ),
    ] = None,
    intercept: Annotated[
        list[str] | None,
        typer.Option(metavar="KEYEXPR", help="Its own router: what goes through interceptors, such as COMMAND_LONG."),
    ] = None,
    interceptor: Annotated[
        list[str] | None,
        typer.Option(metavar="'NAME key=value ...'|FILE.py[:NAME]", help="Its own router: as of riot router."),
    ] = None,
    inject: Annotated[
        Path | None,
        typer.Option(metavar="PLAN.toml", help="Its own router: injections; their topics are intercepted."),
    ] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="OUT.mcap", help="Its own router: record all that passes.")
    ] = None,
    dialect: Annotated[
        str | None, typer.Option(metavar="NAME", help="One of those that pymavlink ships. [default: all]")
    ] = None,
    definitions: Annotated[
        list[Path] | None, typer.Option("--xml", metavar="FILE", help="Defines further messages; repeatable.")
    ] = None,
    keys: Annotated[
        str | None, typer.Option(metavar="TEMPLATE", help="Keys on the bus. [default: mavlink_raw/{link}/{sysid}/...]")
    ] = None,
    duplicates: Annotated[
        float, typer.Option(metavar="SECONDS", help="Drop what came within this time already, over whatever link.")
    ] = 0.0,
    key_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Key of signed frames, for those that come late or are added.")
    ] = None,
    sniffer: Annotated[int, typer.Option(metavar="SYSID", help="A system that gets everything; 0: none.")] = 0,
    mirror: Annotated[
        MirrorMode | None, typer.Option(help="Also publish JSON on mavlink/..., as mavlink-server does, and take such.")
    ] = None,
    form: Format = OutputFormat.TEXT,
) -> None:
    """Route MAVLink between links and segments, until Ctrl-C.

    Links of one segment see each other directly, those of different segments through riot, where their messages can be
    intercepted. With a segment for the autopilot and one for the ground station, riot is between them:

    riot bridge mavlink --inject plan.toml --link system=/dev/ttyACM0,115200 --link unit=tcpin:0.0.0.0:5760

    That is a router, too, and the fastest way; riot ctl speaks to it. With --segment NAME or --endpoint ENDPOINT, the
    bridge joins segments of a running riot router instead.
    """
    from contextlib import ExitStack

    from riot_bus.bridge.own_router import run_own_router
    from riot_bus.bridge.port import open_port
    from riot_bus.bridge.program import end_as
    from riot_bus.bridge.running import run_bridge
    from riot_bus.control.component import client_cfg
    from riot_bus.control.router_flags import RouterFlags
    from riot_bus.control.router_options import RouterOptions, settings_of
    from riot_bus_mavlink.bridge.bridge import MavlinkBridge
    from riot_bus_mavlink.bridge.options import MavlinkBridgeOptions
    from riot_bus_mavlink.dialect import DEFAULT
    from riot_bus_mavlink.keys import TEMPLATE

    joins = segment is not None or endpoint is not None
    wanted = {"listen": listen, "intercept": intercept, "interceptor": interceptor, "inject": inject, "record": record}
    _check_ways(segment, endpoint, cfg, joins=joins, of_router=[name for name, value in wanted.items() if value])
    options = MavlinkBridgeOptions(
        links=link or (),
        dialect=dialect or DEFAULT,
        files=definitions or (),
        keys=keys or TEMPLATE,
        duplicates=duplicates,
        sniffer=sniffer,
        key_file=key_file,
        mirror=None if mirror is None else mirror.value,
        patient=bool(program),
    )
    say, warn, as_json = typer.echo, partial(typer.echo, err=True), form is OutputFormat.JSON
    start = partial(_start, program) if program else None
    if joins:
        places = _places(segment or [f"={endpoint}"], client_cfg(cfg or ()), system=system)
        options.plan(list(places))
        with ExitStack() as stack:
            ports = {
                name: stack.enter_context(open_port(endpoints, config=settings))
                for name, (endpoints, settings) in places.items()
            }
            bridge = MavlinkBridge(ports, options, warn=warn)
            started = None if start is None else partial(start, bridge)
            status = run_bridge(bridge, say=say, as_json=as_json, program=started)
    else:
        flags = RouterFlags(segments=listen or (), intercept=intercept or (), record=record)
        router = RouterOptions(
            system,
            flags,
            interceptors=interceptor or (),
            inject=inject,
            definitions=definitions or (),
            adapters=options.adapters(),
            carried=[options.plan(list(settings_of(system, flags).segments)).keys.expression()],
        )
        status = run_own_router(
            router,
            lambda ports: MavlinkBridge(ports, options, warn=warn),
            say=say,
            warn=warn,
            as_json=as_json,
            program=start,
        )
    if status:
        end_as(status)
        raise typer.Exit(status)


def _check_ways(
    segment: list[str] | None, endpoint: str | None, cfg: list[str] | None, *, joins: bool, of_router: list[str]
) -> None:
    from riot_bus.vocabulary.errors import ConfigError

    where = "riot bridge mavlink"
    if segment is not None and endpoint is not None:
        raise ConfigError("which segment?", where=where, hint="give --segment NAME or --endpoint ENDPOINT, not both")
    if joins and of_router:
        text = f"--{of_router[0]} is for a bridge that is its own router; this one joins another"
        hint = f"give it to riot router, or leave {'--segment' if segment else '--endpoint'} out"
        raise ConfigError(text, where=where, hint=hint)
    if not joins and cfg:
        raise ConfigError("--cfg is for a router elsewhere", where=where, hint="write it into [router] of riot.toml")


def _start(command: list[str], bridge: MavlinkBridge) -> Program:
    from riot_bus.bridge.program import Program

    return Program(command, bridge.words(), ended=bridge.stop)


def _places(
    texts: list[str], config: dict[str, Any], *, system: Path | None
) -> dict[str, tuple[list[str], dict[str, Any]]]:
    """Return where segments listen, and settings of their clients, by name."""
    from riot_bus.control.component import segment_endpoints
    from riot_bus.vocabulary.errors import ConfigError

    places: dict[str, tuple[list[str], dict[str, Any]]] = {}
    for text in texts:
        name, equals, where = text.partition("=")
        if name in places:
            raise ConfigError(f"segment {name!r} is named twice", where="--segment")
        places[name] = ([where], config) if equals else segment_endpoints(name, config, system=system)
    return places
