"""`riot bridge ros2`: its options; imports nothing heavy until it is run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riot_bus_bridges.ros2.options import Ros2BridgeOptions

if TYPE_CHECKING:
    from riot_bus_bridges.cli.bridge import BridgeHost


def ros2(
    context: typer.Context,
    *,
    segment: Annotated[
        str | None,
        typer.Option("--segment", metavar="NAME", help="Segment to join: its name in riot.toml, else system or unit."),
    ] = None,
    system: Path | None = None,
    endpoint: Annotated[
        str | None,
        typer.Option("--endpoint", "-e", metavar="ENDPOINT", help="Where the segment listens, instead of --segment."),
    ] = None,
    cfg: list[str] | None = None,
    options: Ros2BridgeOptions,
    form: str = "text",
) -> None:
    """Join a ROS 2 domain, whatever its middleware, to a segment: topics, services and actions; until Ctrl-C.

    Two bridges, with different domains and on different segments, put `riot router` between the nodes of these domains.
    ROS needs nothing but its own rclpy; on the segment, its nodes look like those of rmw_zenoh.
    """
    from riot_bus_bridges.ros2.bridge import Ros2Bridge

    options.check()
    host: BridgeHost = context.obj
    places = host.ports([] if segment is None else [segment], endpoint, system=system, cfg=cfg or ())
    (port,) = places.values()
    with port as segment_port:
        bridge = Ros2Bridge(segment_port, options, warn=lambda line: typer.echo(line, err=True))
        host.run(bridge, as_json=form == "json")
