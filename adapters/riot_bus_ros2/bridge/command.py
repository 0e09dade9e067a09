"""`riot bridge ros2`: its options; imports nothing heavy until it is run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from riot_bus.types.bridging import BridgeHost

__all__ = ["ros2"]

Names = list[str] | None


def ros2(
    context: typer.Context,
    *,
    domain: Annotated[
        int, typer.Option("--domain", "-d", envvar="ROS_DOMAIN_ID", help="ROS_DOMAIN_ID of the nodes.")
    ] = 0,
    segment: Annotated[
        str | None,
        typer.Option("--segment", metavar="NAME", help="Segment to join: its name in riot.toml, else system or unit."),
    ] = None,
    system: Path | None = None,
    endpoint: Annotated[
        str | None,
        typer.Option("--endpoint", "-e", metavar="ENDPOINT", help="Where the segment listens, instead of --segment."),
    ] = None,
    cfg: Names = None,
    topics: Annotated[
        Names,
        typer.Option(
            metavar="NAME",
            help="Bridge only these topics or actions, such as '/camera/**'; repeatable. [default: all not hidden]",
        ),
    ] = None,
    services: Annotated[
        Names,
        typer.Option(
            metavar="NAME",
            help="Bridge only these services or actions; repeatable. [default: all but those that every node has]",
        ),
    ] = None,
    parameters: Annotated[
        Names,
        typer.Option(metavar="NODE", help="Let parameters of these nodes be set from the other side, too; repeatable."),
    ] = None,
    exclude: Annotated[
        Names, typer.Option(metavar="NAME", help="Leave out these topics, services and actions; repeatable.")
    ] = None,
    zenoh_domain: Annotated[
        int, typer.Option(help="ROS_DOMAIN_ID in the keys on the segment; the same for bridges that are to meet.")
    ] = 0,
    depth: Annotated[int, typer.Option(help="Messages of each topic that the bridge keeps for slow peers.")] = 1000,
    latched: Annotated[
        int, typer.Option(help="Messages of each latched topic that the bridge keeps for late joiners.")
    ] = 100,
    python: Annotated[
        str | None,
        typer.Option(
            metavar="PYTHON", envvar="RIOT_ROS_PYTHON", help="Python that has rclpy. [default: the first on PATH]"
        ),
    ] = None,
    setup: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", envvar="RIOT_ROS_SETUP", help="File to source first, such as /opt/ros/jazzy/setup.bash."
        ),
    ] = None,
    form: str = "text",
) -> None:
    """Join a ROS 2 domain, whatever its middleware, to a segment: topics, services and actions; until Ctrl-C.

    Two bridges, with different domains and on different segments, put `riot router` between the nodes of these domains.
    ROS needs nothing but its own rclpy; on the segment, its nodes look like those of rmw_zenoh.
    """
    from riot_bus_ros2.bridge.bridge import Ros2Bridge
    from riot_bus_ros2.bridge.options import Ros2BridgeOptions

    if (segment is None) == (endpoint is None):
        raise ConfigError("which segment?", where="riot bridge ros2", hint="give --segment NAME or --endpoint ENDPOINT")
    options = Ros2BridgeOptions(
        domain=domain,
        zenoh_domain=zenoh_domain,
        topics=topics,
        services=services,
        parameters=parameters or (),
        exclude=exclude or (),
        depth=depth,
        latched=latched,
        python=python,
        setup=setup,
    )
    options.check()
    host: BridgeHost = context.obj
    places = {segment: None} if segment is not None else {"": endpoint}
    (port,) = host.ports(places, system=system, cfg=cfg or ()).values()
    with port as segment_port:
        bridge = Ros2Bridge(segment_port, options, warn=lambda line: typer.echo(line, err=True))
        host.run(bridge, as_json=form == "json")
