"""`riot bridge mavlink`: its options; imports nothing heavy until it is run."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.flags import flags_of
from riot_bus_bridges.bridging import OwnRouter
from riot_bus_bridges.mavlink.options import MavlinkBridgeOptions

if TYPE_CHECKING:
    from riot_bus_bridges.cli.bridge import BridgeHost

Names = list[str] | None

_WHERE = "riot bridge mavlink"


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
    options: MavlinkBridgeOptions,
    segment: Annotated[
        Names,
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
    router: OwnRouter,
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

    from riot_bus_bridges.mavlink.bridge import MavlinkBridge

    joins = segment is not None or endpoint is not None
    source = context.get_parameter_source("cfg")  # an environment variable may be meant for other commands
    written = cfg if source is not None and source.name == "COMMANDLINE" else None
    of_router = [names[0] for field, _, names in flags_of(OwnRouter) if getattr(router, field.name)]
    if joins and of_router:
        text = f"{of_router[0]} is for a bridge that is its own router; this one joins another"
        hint = f"give it to riot router, or leave {'--segment' if segment else '--endpoint'} out"
        raise ConfigError(text, where=_WHERE, hint=hint)
    if not joins and written:
        raise ConfigError("--cfg is for a router elsewhere", where=_WHERE, hint="write it into [router] of riot.toml")
    options = replace(options, patient=bool(program))
    host: BridgeHost = context.obj
    warn, as_json = partial(typer.echo, err=True), form == "json"
    if joins:
        places = host.ports(segment or (), endpoint, system=system, cfg=cfg or ())
        options.plan(list(places))
        with ExitStack() as stack:
            ports = {name: stack.enter_context(port) for name, port in places.items()}
            bridge = MavlinkBridge(ports, options, warn=warn)
            status = host.run(bridge, program=program or (), as_json=as_json)
    else:
        router = replace(router, system=system, definitions=options.files, adapters=options.adapters())
        plan = options.plan(list(host.segments(router)))
        status = host.run_router(
            lambda ports: MavlinkBridge(ports, options, warn=warn),
            replace(router, carried=[plan.keys.expression()]),
            program=program or (),
            as_json=as_json,
        )
    if status:
        raise typer.Exit(status)
