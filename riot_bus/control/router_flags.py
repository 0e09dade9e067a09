"""Options of `riot router`, declared once; light, since the command line is read before anything else is loaded."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from riot_bus.vocabulary.flags import Definitions, Flag, Interceptors, Seed, Types


@dataclass(frozen=True, slots=True, kw_only=True)
class RouterOptions:
    """What `riot router` was asked to do, as written on its command line; None or empty if not given.

    Attributes:
        adapters: Adapters with options, such as `mavlink:dialect=ardupilotmega`, that replace those of the same name.
        carried: Further key expressions to intercept, for a bridge in the same process.
    """

    system: Annotated[
        Path | None, Flag("System file. [default: riot.toml, if it exists]", "--system -s", "FILE", "RIOT_SYSTEM")
    ] = None
    segments: Annotated[
        Sequence[str],
        Flag(
            "A segment and where it listens; repeatable. "
            "[default: system=tcp/127.0.0.1:7447 and unit=tcp/127.0.0.1:7448]",
            "--segment",
            "NAME=ENDPOINT[,ENDPOINT...]",
            "RIOT_SEGMENT",
        ),
    ] = ()
    connect: Annotated[
        Sequence[str], Flag("A router that a segment joins.", "", "SEGMENT=ENDPOINT[,...]", "RIOT_CONNECT")
    ] = ()
    cfg: Annotated[
        Sequence[str],
        Flag("A Zenoh setting of a segment; KEY=@FILE for secrets; repeatable.", "", "SEGMENT:KEY=VALUE", "RIOT_CFG"),
    ] = ()
    name: Annotated[str | None, Flag("The router's name. [default: router]", "", "NAME", "RIOT_NAME")] = None
    intercept: Annotated[
        Sequence[str],
        Flag("What goes through the interceptors; ROS names such as /odom will do.", "", "KEYEXPR", "RIOT_INTERCEPT"),
    ] = ()
    services: Annotated[
        Sequence[str],
        Flag(
            "Services and actions whose requests and replies go through the interceptors; repeatable.",
            "--intercept-services",
            "KEYEXPR",
            "RIOT_INTERCEPT_SERVICES",
        ),
    ] = ()
    interceptors: Interceptors = ()
    inject: Annotated[
        Path | None, Flag("Injections; their topics are intercepted.", "", "PLAN.toml", "RIOT_INJECT")
    ] = None
    record: Annotated[
        Path | None, Flag("Record all that passes, intercepted or not.", "", "OUT.mcap", "RIOT_RECORD")
    ] = None
    types: Types = ()
    definitions: Definitions = ()
    seed: Seed = 0
    budget: Annotated[
        float | None, Flag("How long an interceptor may block. [default: 1]", "", "SECONDS", "RIOT_BUDGET")
    ] = None
    control: Annotated[
        Sequence[str],
        Flag(
            "A segment from which riot ctl may be used; repeatable. [default: those that only this host reaches]",
            "",
            "SEGMENT",
            "RIOT_CONTROL",
        ),
    ] = ()
    bypass_watch: Annotated[bool, Flag("Look for ways around the router.")] = True
    adapters: Sequence[str] = ()
    carried: Sequence[str] = ()
