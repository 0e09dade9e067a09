"""`riot ros-test`: runs existing tests through a router of their own, unedited."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from riot_bus.cli.declared import declared
from riot_bus.cli.fastpath import warn
from riot_bus.cli.help_groups import BUS
from riot_bus.control.router_flags import RouterOptions

_ROUTER = ("intercept", "services", "interceptors", "inject", "types", "definitions", "seed")


def register(app: typer.Typer) -> None:
    """Add this module's commands."""
    app.command("ros-test", rich_help_panel=BUS, context_settings={"allow_interspersed_args": False})(ros_test)


@declared(RouterOptions, *_ROUTER, before="record")
def ros_test(
    command: Annotated[list[str], typer.Argument(metavar="COMMAND", help="colcon test, pytest, launch_test, ...")],
    *,
    unit_nodes: Annotated[
        str | None,
        typer.Option(
            metavar="REGEX",
            help="Programs, scripts and ROS nodes of these names are in segment unit, all others in system.",
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="OUT.mcap|FOLDER", help="Record all that passes; in FOLDER, a log per package."),
    ] = None,
    dds: Annotated[
        bool, typer.Option("--dds", help="Nodes use DDS: each segment has a ROS domain of its own, and a bridge to it.")
    ] = False,
    system: Annotated[
        Path | None,
        typer.Option(
            "--system",
            "-s",
            metavar="FILE",
            envvar="RIOT_SYSTEM",
            help="System file; its segments are not used. [default: riot.toml, if it exists]",
        ),
    ] = None,
    package: Annotated[str, typer.Option(hidden=True)] = "",
    in_: Annotated[Path | None, typer.Option("--in", hidden=True)] = None,
    account: Annotated[Path | None, typer.Option(hidden=True)] = None,
    **given: Any,
) -> None:
    """Run existing tests, unedited, through a router of their own; with colcon test, one router for each package.

    The exit status is the command's. At the end, stderr says what passed through the router, or that nothing did.
    No process of the tests is left behind.
    """
    from riot_bus_bridges.host.running import end_as
    from riot_bus_bridges.ros_test.run import RosTest, run_tests

    words = sys.argv[2 : len(sys.argv) - len(command)]
    asked = RosTest(
        router=RouterOptions(system=system, **given),
        nodes=unit_nodes,
        dds=dds,
        record=record,
        package=package,
        folder=in_,
        account=account,
        words=words[:-1] if words[-1:] == ["--"] else words,
    )
    status = run_tests(command, asked, warn=warn)
    end_as(status)
    raise typer.Exit(status)
